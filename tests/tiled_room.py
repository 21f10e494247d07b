"""A small room whose southern façade is drawn in several ways."""

from drcmitsuba.case.case import Case
from drcmitsuba.runtime.toml import checked

SIZE = [4.0, 5.0, 3.0]
MATERIALS = {
    "glass": {"type": "glazing", "transmittance": 0.65, "reflectance": 0.15},
    "fabric": {"type": "diffuser", "transmittance": 0.3, "reflectance": 0.5},
    "shade": {"type": "diffuser", "transmittance": 0.1, "reflectance": 0.4},
}
PLAIN = [
    {"bottom": 0.9, "top": 1.8, "material": "glass"},
    {"bottom": 1.8, "top": 2.7, "material": "fabric"},
]
MIXED = [
    {"bottom": 0.9, "top": 1.8, "material": "glass", "segments": [0]},
    {"bottom": 0.9, "top": 1.8, "material": "wall", "segments": [1]},
    {"bottom": 1.8, "top": 2.7, "material": "fabric", "segments": [1]},
    {"bottom": 1.8, "top": 2.7, "material": "open", "segments": [0]},
]


def room(strips, side="south", frame=0.0, **changes):
    tables = {
        "room": {"size": SIZE, "floor": 0.3, "ceiling": 0.8, "walls": 0.6},
        "materials": MATERIALS,
        "facade": {side: {"segments": 2, "frame": frame, "strips": strips}},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
        "shading": {"material": "shade"},
        "period": {"months": [3], "hours": [9, 15]},
        "accuracy": {"paths": 64, "sensor_sky_rays": 512},
    }
    return checked(Case, tables | changes, "room.toml")
