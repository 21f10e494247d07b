"""Strips in some segments of a façade only: geometry adds up, overlap counts by segment."""

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked
from drcmitsuba.scene import scene
from drcmitsuba.scene.surfaces import surfaces_of

SIZE = np.array([4.0, 5.0, 3.0])
MATERIALS = {
    "glass": {"type": "glazing", "transmittance": 0.65},
    "fabric": {"type": "diffuser", "transmittance": 0.3},
    "shade": {"type": "diffuser", "transmittance": 0.1},
}
SIDES = ["south", "east", "north", "west"]
MIXED = [
    {"bottom": 0.9, "top": 1.8, "material": "glass", "segments": [0, 3]},
    {"bottom": 0.9, "top": 1.8, "material": "fabric", "segments": [1]},
    {"bottom": 1.8, "top": 2.7, "material": "fabric", "segments": [0]},
    {"bottom": 1.2, "top": 2.4, "material": "glass", "segments": [2]},
    {"bottom": 1.9, "top": 2.4, "material": "wall", "segments": [1, 3]},
]


def case(strips, side="south", **changes):
    facade = {"segments": 4, "frame": 0.1, "strips": strips} | changes
    tables = {
        "room": {"size": list(SIZE)},
        "materials": MATERIALS,
        "facade": {side: facade},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
        "shading": {"material": "shade"},
    }
    return checked(Case, tables, "room.toml")


def areas(surfaces, side, word=""):
    quads = [s.quads for s in surfaces if s.name.endswith(side) and word in s.name]
    crossed = [np.cross(q[:, 1] - q[:, 0], q[:, 3] - q[:, 0]) for q in quads]
    return sum(np.linalg.norm(c, axis=1).sum() for c in crossed)


def width(side):
    return SIZE[0] if side in ("south", "north") else SIZE[1]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("frame", [0.0, 0.1])
def test_mixed_segments_are_wall_and_frame_and_panes_and_nothing_else(side, frame):
    surfaces = surfaces_of(case(MIXED, side, frame=frame))
    segment = width(side) / 4
    assert areas(surfaces, side) == pytest.approx(width(side) * 3.0, rel=1e-12)
    glass = (segment - frame) * (2 * (0.9 - frame) + (1.2 - frame))
    fabric = (segment - frame) * 2 * (0.9 - frame)
    assert areas(surfaces, side, "glass") == pytest.approx(glass, rel=1e-12)
    assert areas(surfaces, side, "fabric") == pytest.approx(fabric, rel=1e-12)
    window = segment * (3 * 0.9 + 0.9 + 1.2)
    assert areas(surfaces, side, "frame") == pytest.approx(window - glass - fabric, abs=1e-12)


@pytest.mark.parametrize("side", SIDES)
def test_every_point_of_the_wall_is_covered_once(side):
    axis, at = {"south": (1, 0.0), "north": (1, 5.0), "west": (0, 0.0), "east": (0, 4.0)}[side]
    surfaces = surfaces_of(case(MIXED, side))
    quads = np.concatenate([s.quads for s in surfaces if s.name.endswith(side)])
    np.testing.assert_allclose(quads[..., axis], at, atol=1e-12)
    low, high = quads.min(axis=1), quads.max(axis=1)
    points = np.random.default_rng(0).uniform(0, SIZE, (2000, 3))
    points[:, axis] = at
    inside = ((points[:, None] >= low - 1e-12) & (points[:, None] <= high + 1e-12)).all(axis=2)
    np.testing.assert_array_equal(inside.sum(axis=1), 1)


@pytest.mark.parametrize(
    ("side", "axis", "first"),
    [("south", 0, 0.0), ("east", 1, 0.0), ("north", 0, 4.0), ("west", 1, 5.0)],
)
def test_segments_count_from_the_left_seen_from_outside(side, axis, first):
    one = [{"bottom": 1.0, "top": 2.0, "material": "glass", "segments": [0]}]
    glass = next(s for s in surfaces_of(case(one, side)) if s.name.startswith("glass"))
    away = np.abs(glass.quads[..., axis] - first)
    assert away.max() < width(side) / 4
    assert len(glass.quads) == 1


def test_all_segments_named_are_the_strip_without_segments():
    whole = [{"bottom": 0.9, "top": 1.8, "material": "glass"}]
    named = [{"bottom": 0.9, "top": 1.8, "material": "glass", "segments": [3, 1, 0, 2]}]
    for a, b in zip(surfaces_of(case(whole)), surfaces_of(case(named)), strict=True):
        np.testing.assert_array_equal(a.quads, b.quads)
        assert (a.name, a.material) == (b.name, b.material)


def test_the_enclosure_is_open_at_the_clear_segments_only():
    backend.select()
    strips = [
        {"bottom": 0.9, "top": 1.8, "material": "glass", "segments": [1, 2]},
        {"bottom": 0.9, "top": 1.8, "material": "fabric", "segments": [0, 3]},
    ]
    openings = scene.load(case(strips)).enclosure.openings
    np.testing.assert_allclose(openings.min(axis=(0, 1)), [1, 0, 0.9])
    np.testing.assert_allclose(openings.max(axis=(0, 1)), [3, 0, 1.8])
    assert scene.load(case(strips), "shaded").enclosure.openings.shape == (0, 4, 3)


def strip(bottom, top, segments):
    return {"bottom": bottom, "top": top, "material": "glass", "segments": segments}


@pytest.mark.parametrize(
    ("strips", "line"),
    [
        ([strip(0.9, 1.8, [4])], "facade.south.strips, 0.9 to 1.8 m: there is no segment 4 of 4; "
         "count from 0 to 3"),
        ([strip(0.9, 1.8, [0, 0])], "facade.south.strips.0.segments: [0, 0] names one twice; "
         "name each segment once"),
        ([strip(0.9, 1.8, [])], "facade.south.strips.0.segments: got []; give at least 1"),
        ([strip(0.9, 1.8, [-1])], "facade.south.strips.0.segments.0: got -1; input should be "
         "greater than or equal to 0"),
        ([strip(0.9, 1.8, [1, 2]), strip(1.5, 2.0, [2])], "facade.south.strips, 1.5 to 2 m: "
         "overlaps the strip below it; start at 1.8 m or above"),
        ([strip(0.9, 1.8, [1, 2]), {"bottom": 1.5, "top": 2.0, "material": "glass"}],
         "facade.south.strips, 1.5 to 2 m: overlaps the strip below it; start at 1.8 m or above"),
    ],
)  # fmt: skip
def test_strips_that_do_not_fit_are_refused(strips, line):
    with pytest.raises(InputError) as caught:
        case(strips)
    assert str(caught.value) == f"room.toml: {line}"


def test_strips_of_other_segments_may_overlap_in_height():
    assert len(case([strip(0.9, 1.8, [0]), strip(1.5, 2.0, [1])]).facade["south"].strips) == 2
