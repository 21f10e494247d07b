"""Report: pictures of results, drawn from arrays and numbers alone.

figures
    All pictures of an evaluation, by file name.
plots
    Every kind of picture by its name.
plan_view, tiles
    Plans in false colours; tiles of a grid of sensors.
metric_charts
    Metrics of a period and of its months.
style
    Colours, lines and PNG files.
captions
    Weather, period and accuracy in words.
"""
