"""Annual: from a case to the illuminances and metrics of its period.

run
    `Run`: seed, enabled effects, seconds and rays, which go through an evaluation.
simulation, attributes
    Coefficients C of both states of a case, and their attributes: the case, its weather, its groups
    of panes, and a digest of all of it.
pane_group_of_sun
    Group of panes through which each sun comes straight to a sensor, for the rule of shades.
hours_in_any_weather, applied_states
    Hours at which the façade may take each state in any weather; the state that it takes.
simulated_year
    States that the façade takes in a year, and their light.
sample_accumulator, adaptive_sampling
    Coefficients to which samples are added, until the intervals are as narrow as the target.
choice, moving_groups, chosen_facade
    Fills that stay in openings, groups that move beside them, and the light of both.
light_with_surfaces
    Light by element of each set of surfaces that fills bring.
elements, weighed_year, recombined_year
    Light of a case by opening and fill; E of any façade, summed where it is asked for; its metrics.
summed_year, controlled
    Years of many states as sums over elements; years whose groups follow a control.
spectral_year
    Light of a year by bands of the spectrum, at sensors and eyes.
workers, block_parts
    Processes that make blocks, and their shares.
sensor_stream, large_year, large_result
    A year of any number of sensors, summed block by block.
saved_result, result
    `evaluate`, `Result`: from a case to numbers, files and pictures; the data flow in ten lines.
light_tracing, lights
    Who lights a point: C and the year's light by window, state, source and number of bounces.
variants, season
    Several façades of one room; monthly values relative to an open window.
study, study_facades
    Many variations of a case; those that differ in their façades, from one simulation.
tradeoff
    Accuracy against time.
bench
    Seconds beside Radiance, at equal error.
"""
