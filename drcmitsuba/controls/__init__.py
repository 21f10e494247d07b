"""Controls: the states of groups of panes from E, weather and time; electric light as a result.

Each control is a pure function `(E, weather, time, *, groups, …) → state (time, group)`.

control
    `Control`, what a control is; `called`, any function of the user's; `seasonal`.
rules
    `lm83`, `scheduled`.
hysteresis
    `work_plane`, `facade_irradiance`, `vertical_illuminance`, with thresholds to close and reopen.
slats
    `cut_off`: the flattest slats that keep the sun out.
best
    `best_state` of every hour by an objective.
glare
    `glare`: the first state in which no eye is dazzled.
outside
    Weather that controls see.
schedule_file
    States as a schedule of the case.
electric_light
    Dimming to a set point, and its energy.
space_lights
    Electric light of every space by its own target and hours.
"""

from drcmitsuba.controls.best import best_state
from drcmitsuba.controls.control import Control, called, seasonal, states_of
from drcmitsuba.controls.electric_light import (
    continuous_dimming,
    dimming_to_off,
    lighting_energy,
    stepped_dimming,
    zone_illuminance,
)
from drcmitsuba.controls.glare import glare
from drcmitsuba.controls.hysteresis import (
    closed_by,
    facade_irradiance,
    vertical_illuminance,
    work_plane,
)
from drcmitsuba.controls.outside import outside
from drcmitsuba.controls.rules import lm83, scheduled
from drcmitsuba.controls.schedule_file import groups_of, save_schedule
from drcmitsuba.controls.slats import cut_off, cut_off_angle, profile_angle

__all__ = [
    "Control",
    "best_state",
    "called",
    "closed_by",
    "continuous_dimming",
    "cut_off",
    "cut_off_angle",
    "dimming_to_off",
    "facade_irradiance",
    "glare",
    "groups_of",
    "lighting_energy",
    "lm83",
    "outside",
    "profile_angle",
    "save_schedule",
    "scheduled",
    "seasonal",
    "states_of",
    "stepped_dimming",
    "vertical_illuminance",
    "work_plane",
    "zone_illuminance",
]
