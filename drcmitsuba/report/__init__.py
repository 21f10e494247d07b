"""Report: pictures of results, drawn from arrays and numbers alone.

plots
    Plans in false colours, metrics of the months.
figures
    All pictures of an evaluation.
"""
