"""Annual: from a case to the illuminances and metrics of its period.

simulation
    Coefficients of all states.
sample_accumulator, adaptive_sampling
    Coefficients to which samples are added, until the intervals are as narrow as asked for.
result
    `evaluate`: one evaluation from case to numbers, files and pictures.
variants, season
    Several façades of one room; months with the season taken out.
tradeoff
    Accuracy against time.
"""
