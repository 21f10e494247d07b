"""Command line: `drcmitsuba VERB …`, one module for each group of verbs.

main
    The program: its options, and the line with which it ends.
startup, terminal, near_signs
    Start of a command that runs kernels; progress bars, tables and notes; signs that a terminal
    lacks.
options
    Arguments and options that several commands share.
evaluate, season, study, tradeoff
    Years: one, of several façades, relative to an open window, of many rows, of many settings.
optimise, comply
    Search for a façade; verdicts on standards, and the least change for the next level.
render, glare, lights
    Pictures; a year of glare; who lights a point.
plan, bench, cache
    What a case calls for and costs; seconds beside Radiance; coefficients that are kept.
case, export, report
    A scene before it is simulated; files of other programs; the page that a client reads.
films
    `bsdf`, `goniophotometer`: films from measurements and structures.
steps
    `sky`, `coefficients`, `illuminance`, `metrics`, `plot`: an evaluation step by step.
information
    `schema`, `doctor`, `new`: about the program.
"""
