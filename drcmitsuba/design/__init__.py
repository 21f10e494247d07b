"""Design: free parameters of façades, films, lamellae and surfaces, and searches for the best.

parameters, free_transmittances
    Values with bounds and a start; transmittances of panes and of the shade among them.
slopes
    Gradients of a design's numbers, computed when they are first asked for.
measure, candidate
    Rating of a year, smooth and hard; a composition with both.
facade_maps, facade_tiles, cut_tiles
    From parameters to façades; their tiles; straight sun by the strips that tiles are built of.
facade_groups, facade_glare
    Panes that close one by one; hours of glare, of eyes that the caller passes.
facade_year
    A façade under the sky of a period: illuminance by any composition, with gradients.
goal, constraints, problem
    What `[design]` asks for, its limits, and both as functions of parameters.
search, gradient_search, hard_search, area_search
    Step, history, loop and optimum; by gradients, by hard numbers alone, for the least area.
any_layout, layout, model_layout
    Design space of any case: of a room of boxes, of the panes and walls of a model.
model_openings, model_windows, wall_picture
    Openings of a model that a search fills; windows that tiles become; the picture of its walls.
realise, optimise
    From an optimum to a case to be built; `optimise`: from `[design]` to both.
requirement, composed_facades, present_facade, change_problem, change_search
    What a level of a standard asks for, and the search for the least change that reaches it.
cheapest_change, change
    `cheapest_change`: the least change for the next level, simulated afresh.
film, film_bins, film_year, film_problem, film_search
    A year as a function of its film, and the search for a film.
simulated_tilt, tilt, tilt_search
    A year with lamellae at one tilt, and the search for the best.
reflectances, traced_room, room_matrices, surface_kinds
    A year as a function of the reflectances in a room.
pictures
    Plots of fronts, façades, searches and tilts.
"""
