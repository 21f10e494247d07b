"""Design: free parameters of façades, films, lamellae and surfaces, and searches for the best.

- `parameters`: values with bounds and a start; `facade_maps`: from parameters to façades
- `measure`: rating of a year, smooth and hard; `search`: step, history, loop and optimum
- `layout`, `goal`, `problem`, `optimise`, `realise`: the façade, from `[design]` to a case to be
  built; `constraints`, `area_search`: parts of `optimise`, for the least area the last one;
  `model_layout`: the panes of a model; `facade_groups`: panes that close one by one;
  `cut_tiles`: straight sun by the strips that tiles are built of;
  `facade_glare`: hours of glare, of eyes that the caller passes
- `cheapest_change`, `change`: the least change for the next level of a standard; `requirement`,
  `change_problem`, `change_search`, `composed_facades`, `present_facade`
- `tilt`, `tilt_search`: the tilt of lamellae
- `film`, `film_bins`, `film_year`: a year as a function of its film; `film_problem`, `film_search`
- `reflectances`, `traced_room`, `room_matrices`, `surface_kinds`: a year as a function of the
  reflectances in a room
- `pictures`: plots of fronts, façades, searches and tilts
"""
