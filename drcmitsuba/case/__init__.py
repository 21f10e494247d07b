"""Case file: the simulated room, façade, sky and accuracy, checked before anything runs.

case, reading
    `Case`: all tables together; `load_case`: from a file to a case.
unit_check
    Refusal of lengths that look like millimetres.
weather, sky, sun
    Place, weather file and period; sky and ground; model of the sun.
room, facade, furniture, sensors
    The room, its sides with panes, boxes and plates, points of the illuminance.
components, shading
    Components that are geometry; the sun shade.
metrics, accuracy, effects, design
    Thresholds; numbers of samples; simulated effects of light; the search of `optimise`.
shipped
    Cases and recipes that come with the package.
"""
