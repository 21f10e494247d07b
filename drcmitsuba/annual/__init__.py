"""Annual: from a case to the illuminances and metrics of its period.

run
    `Run`: seed, enabled effects, seconds and rays, which go through an evaluation.
simulation
    Coefficients C of both states of a case.
applied_states
    State that the shade takes at each time stamp, by the direct sun alone.
sample_accumulator, adaptive_sampling
    Coefficients to which samples are added, until the intervals are as narrow as the target.
sensor_stream, large_year, large_result
    A year of any number of sensors, summed block by block.
saved_result, result
    `evaluate`, `Result`: from a case to numbers, files and pictures; the data flow in ten lines.
nearest_sensors, lights
    Who lights a point: C and the year's light by window, state, source and number of bounces.
variants, season
    Several façades of one room; monthly values relative to an open window.
study
    Many variations of a case.
tradeoff
    Accuracy against time.
bench
    Seconds beside Radiance, at equal error.
"""
