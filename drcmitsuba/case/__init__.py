"""Case file: the simulated room, façade, sky and accuracy, checked before anything runs.

toml, unit_check
    Reading and checking of tables; lengths that look like millimetres.
sky, facade, materials, components, design, effects, accuracy
    One module for the tables of each subject.
case
    `Case`: all tables together; `load_case`.
shipped
    Cases and recipes that come with the package.
"""
