"""Annual: from a case to the illuminances and metrics of its period.

run
    `Run`: seed, enabled effects, seconds and rays, which go through an evaluation.
simulation
    Coefficients C of both states of a case.
sample_accumulator, adaptive_sampling
    Coefficients to which samples are added, until the intervals are as narrow as the target.
result
    `evaluate`, `Result`: from a case to numbers, files and pictures; the data flow in ten lines.
lights
    Who lights a point: C and the year's light by window, state, source and number of bounces.
variants, season
    Several façades of one room; monthly values relative to an open window.
tradeoff
    Accuracy against time.
"""
