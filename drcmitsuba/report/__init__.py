"""Report: pictures and pages of results, made from arrays and numbers alone.

figures
    All pictures of an evaluation, by file name.
plots
    Every kind of picture by its name.
year_figures
    Further pictures of an evaluation: mountains, a section, temporal maps, the path of the sun.
standing, plan_sheet
    What many figures have in common, which is drawn once; that of plans.
outlines, edges, scene_view
    Lines of a case in plan; edges of surfaces; a scene before anything is simulated.
sheets, sensor_marks, side_by_side
    Sensors that one plan shows; how it marks them; plans of several façades.
plan_view, mountain, section, tiles
    Values of sensors in plan, as a mountain, along a line; tiles of a grid of sensors.
temporal_map, sun_path, sky_dome
    Values by day and hour; suns of a period; values of the bins over the sky.
metric_charts
    Metrics of a period and of its months.
study_charts, glare_plots, lights
    Pictures of a study, of a year of glare, of the light of chosen points.
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
