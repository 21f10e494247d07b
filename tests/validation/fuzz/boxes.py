"""Random rooms of boxes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from drcmitsuba.case.case import Case
from tests.validation.calibration.rooms import PRISM

SIDES = {"south": 0, "east": 1, "north": 0, "west": 1}
"""Axis along which each side runs."""


def random_box(rng: np.random.Generator) -> Case:
    """Room with panes of two materials on one to three sides, furniture, and obstructions."""
    size = np.round(rng.uniform([3, 3, 2.4], [9, 9, 4.5]), 2)
    number = rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15])
    sides = rng.choice(list(SIDES), size=number, replace=False)
    low, high = np.array([0.3, 0.3, 0.1]), size - [0.3, 0.3, 0.3]
    count = 4, 5
    spacing = float(((high - low)[:2] / count).min())
    return Case.model_validate({
        "room": {
            "size": size.tolist(), "rotation": float(rng.choice([0, rng.integers(-180, 180)])),
            "floor": float(rng.uniform(0.05, 0.5)), "walls": float(rng.uniform(0.1, 0.85)),
            "ceiling": float(rng.uniform(0.2, 0.9)),
        },
        "facade": {str(side): facade(rng, size, str(side)) for side in sides},
        "materials": {"first": pane(rng), "second": pane(rng)},
        "furniture": [
            *(body(rng, low, high, stands=i == 0) for i in range(rng.integers(0, 4))),
            *(outside(rng, size, str(side)) for side in sides if rng.random() < 0.4),
        ],
        "sensors": {
            "corner": [*low[:2].tolist(), float(rng.uniform(0.1, 1.2))], "count": count,
            "spacing": spacing,
        },
    })  # fmt: skip


KINDS = {"glazing": 0.5, "diffuser": 0.2, "fabric": 0.15, "film": 0.15}
"""Kinds of panes, and how likely each is drawn."""


def pane(rng: np.random.Generator, kinds: Mapping[str, float] = KINDS) -> dict[str, Any]:
    """Material of panes: clear glass, a diffusing sheet, a fabric, or a measured film."""
    kind = rng.choice([*kinds], p=[*kinds.values()])
    if kind == "film":
        return {"type": "bsdf", "file": str(PRISM), "straight_through": "off"}
    if kind == "glazing":
        mirrored = float(rng.choice([0.0, 0.1, 0.4]))
        passed = float(rng.uniform(0.1, 0.9 - mirrored))
        return {"type": "glazing", "transmittance": passed, "reflectance": mirrored}
    straight = float(rng.uniform(0.02, 0.3)) if kind == "fabric" else 0.0
    passed, back, front = rng.uniform([0.1, 0, 0], [0.4, 0.5, 0.5])
    return {
        "type": "diffuser", "transmittance": float(passed), "straight": straight,
        "reflectance": min(float(back), 0.95 - passed - straight),
        "outer_reflectance": float(front),
    }  # fmt: skip


def facade(rng: np.random.Generator, size: np.ndarray, side: str) -> dict[str, Any]:
    """One or two strips in one to four segments, some of which are wall."""
    height, segments = float(size[2]), int(rng.integers(1, 5))
    edges = np.sort(np.round(rng.uniform(0.05, height - 0.05, 3), 2))
    names = ["first", "second"][: 1 if edges[2] - edges[1] < 0.2 else 2]
    strips = []
    for name, bottom, top in zip(names, edges, edges[1:], strict=False):
        some = np.flatnonzero(rng.random(segments) < 0.8).tolist() or [0]
        strip = {"bottom": float(bottom), "top": float(max(top, bottom + 0.2)), "material": name}
        strips.append(strip | {"segments": some})
    for lower, upper in itertools.pairwise(strips):
        upper["bottom"] = max(upper["bottom"], lower["top"])
    return {"segments": segments, "frame": float(rng.choice([0, 0.06])), "strips": strips}


def body(
    rng: np.random.Generator, low: np.ndarray, high: np.ndarray, stands: bool
) -> dict[str, Any]:
    """Box or plate within the room; one of those that stand on the floor cuts no other."""
    corners = np.sort(np.round(rng.uniform(low, high, (2, 3)), 2), axis=0)
    size = np.maximum(corners[1] - corners[0], 0.02)
    if stands:
        corners[0, 2] = 0.0
    return {
        "corner": corners[0].tolist(), "size": size.tolist(),
        "reflectance": float(rng.uniform(0.05, 0.8)),
    }  # fmt: skip


def outside(rng: np.random.Generator, size: np.ndarray, side: str) -> dict[str, Any]:
    """Overhang or block before a side."""
    along, inward = SIDES[side], 1 - SIDES[side]
    sign = 1 if side in ("north", "east") else -1
    depth = float(np.round(rng.uniform(0.3, 2.0), 2))
    away = 0.0 if (overhang := rng.random() < 0.5) else float(rng.uniform(1.0, 8.0))
    corner, extent = np.zeros(3), np.array([0.0, 0.0, 0.1])
    extent[along], extent[inward] = size[along], depth
    corner[inward] = size[inward] + away if sign > 0 else -away - depth
    corner[2] = float(size[2]) if overhang else 0.0
    extent[2] = 0.1 if overhang else float(rng.uniform(1.0, 9.0))
    return {
        "corner": corner.round(3).tolist(), "size": extent.round(3).tolist(),
        "reflectance": float(rng.uniform(0.1, 0.8)),
    }  # fmt: skip
