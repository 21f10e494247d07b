"""Case file: the simulated room, façade, sky and accuracy, checked before anything runs.

case, reading
    `Case`: all tables together; `load_case`: from a file to a case.
model_case
    A case for a model alone, and the case file that one would edit.
unit_check
    Refusal of lengths that look like millimetres.
weather, sky, sun
    Place, weather file and period; sky and ground; model of the sun.
room, model, facade, furniture, sensors
    The room, or a model in its place; its sides with panes, boxes and plates, points of the
    illuminance.
components, shading
    Components that are geometry; the sun shade.
groups, schedule
    Panes that change their state together; a state for every hour of the year.
spaces, uses
    Rooms of a building, and what they are used for: targets and hours.
views, colour
    Where an eye is and what it looks at; bands of the light, spectra of sources and surfaces.
metrics, accuracy, effects, design
    Thresholds; numbers of samples; simulated effects of light; the search of `optimise`.
output, study
    Which spaces are evaluated, and what is kept; rows of changed keys of a case.
shipped
    Cases and recipes that come with the package.
"""
