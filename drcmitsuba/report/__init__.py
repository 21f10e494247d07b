"""Report: pictures and pages of results, made from arrays and numbers alone.

figures
    All pictures of an evaluation, by file name.
plots
    Every kind of picture by its name.
plan_view, tiles
    Plans in false colours; tiles of a grid of sensors.
metric_charts
    Metrics of a period and of its months.
metrics_file
    Reading of `metrics.json`.
document
    The report that a client reads, as one page of HTML.
style
    Colours, lines and PNG files.
captions
    Weather, period and accuracy in words.
"""
