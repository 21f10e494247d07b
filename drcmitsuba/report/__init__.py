"""Report: pictures and pages of results, made from arrays and numbers alone.

figures
    All pictures of an evaluation, by file name.
plots
    Every kind of picture by its name.
year_figures
    Further pictures of an evaluation: mountains, a section, temporal maps, the path of the sun.
standing, plan_sheet
    What many figures have in common, which is drawn once; that of plans.
plan_view, mountain, section, tiles
    Values of sensors in plan, as a mountain, along a line; tiles of a grid of sensors.
temporal_map, sun_path, sky_dome
    Values by day and hour; suns of a period; values of the bins over the sky.
metric_charts
    Metrics of a period and of its months.
metrics_file
    Reading of `metrics.json`.
document
    The report that a client reads, as one page of HTML.
colour_scale
    From numbers to colours, and the bar beside them.
style
    Colours, lines and PNG files.
captions
    Weather, period and accuracy in words.
"""
