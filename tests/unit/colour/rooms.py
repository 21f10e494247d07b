"""A small room for tests of colour."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import case_from
from drcmitsuba.model.materials import SurfaceMaterial
from drcmitsuba.scene.geometry import Surface


def surface(name: str, material: SurfaceMaterial, behind: str = "") -> Surface:
    """Surface of any place."""
    return Surface(name, material, np.zeros((0, 4, 3)), behind=behind)


def box(**tables: Any) -> Case:
    """Room of 4 m with a glazed side and 9 sensors, for 2 hours of some days."""
    plain: dict[str, Any] = {
        "name": "box",
        "room": {"size": [4.0, 4.0, 3.0], "floor": 0.3, "ceiling": 0.8, "walls": 0.5},
        "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.7, "material": "glass"}]}},
        "materials": {"glass": {"type": "glazing", "transmittance": 0.6}},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 3], "spacing": 1.0},
        "period": {"months": [1, 3, 6, 9], "hours": [9, 16]},
        "accuracy": {"paths": 32, "cell_paths": 8, "cell_sky_rays": 64, "sensor_sky_rays": 256},
    }
    return case_from({**plain, **tables}, Path("case.toml"))
