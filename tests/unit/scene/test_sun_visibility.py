"""Suns that are said not to get in do not get in; those that plainly do not are known."""

import numpy as np
import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.scene.components import place
from drcmitsuba.scene.sun_visibility import SunVisibility
from drcmitsuba.sky.sun_models import Suns

SIZE = [4.0, 5.0, 3.0]
WINDOW = {"strips": [{"bottom": 1.0, "top": 2.0, "material": "open"}]}


@pytest.fixture(autouse=True)
def _variant():
    backend.select()


def room(*furniture, sides=("south",), rotation=0.0):
    return Case.model_validate(
        {
            "room": {"size": SIZE, "walls": 0.6, "rotation": rotation},
            "facade": dict.fromkeys(sides, WINDOW),
            "furniture": list(furniture),
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 3], "spacing": 1.0},
            "accuracy": {"replicates": 2, "paths": 256, "cell_size": 0.9, "cell_sky_rays": 16},
        }
    )


def sun(azimuth, elevation):
    a, h = np.radians([azimuth, elevation])
    return np.array([np.sin(a) * np.cos(h), np.cos(a) * np.cos(h), np.sin(h)])


def reached(case, *suns, diameter=0.5):
    return SunVisibility.of(case, place(case)).visible(np.reshape(suns, (-1, 3)), diameter)


def box(corner, size, reflectance=0.5):
    return {"corner": corner, "size": size, "reflectance": reflectance}


def test_a_sun_gets_in_where_its_disk_is_before_an_opening():
    case = room()
    suns = [sun(180, 30), sun(0, 30), sun(90.1, 30), sun(89.9, 30), sun(89.5, 30)]
    visible = reached(case, *suns)
    np.testing.assert_array_equal(visible.mask, [True, False, True, True, False])
    assert (visible.behind, visible.hidden) == (2, 0)
    assert visible.largest == pytest.approx(np.cos(np.radians(30)))


@pytest.mark.parametrize("rotation", [0.0, 37.0, -90.0])
def test_the_room_is_turned_with_its_openings(rotation):
    visible = reached(room(rotation=rotation), sun(180 + rotation, 20), sun(rotation, 20))
    np.testing.assert_array_equal(visible.mask, [True, False])


def test_a_room_without_openings_lets_no_sun_in():
    visible = reached(room(sides=()), sun(180, 30))
    assert not visible.mask.any()
    assert visible.largest == -1


def test_no_room_tells_nothing():
    open_air = Case.model_validate({"sensors": {"corner": [0, 0, 0], "count": [1, 1]}})
    assert SunVisibility.of(open_air, ()) is None


def test_a_wall_across_the_street_hides_low_suns_and_no_more():
    """Its top, 7 m up and 10 m away, is at atan((7 − 2) / 10) seen from the lintel, 26.57°."""
    case = room(box([-40, -10.5, -1], [84, 0.5, 8], reflectance=0.0))
    limit = np.degrees(np.arctan2(7 - 2.0, 10))
    visible = reached(case, sun(180, limit - 0.4), sun(180, limit + 0.3), sun(180, 70), sun(0, 70))
    np.testing.assert_array_equal(visible.mask, [False, True, True, False])
    assert (visible.behind, visible.hidden) == (1, 1)


def test_a_wall_to_the_north_hands_the_southern_sun_on():
    """It lights the front of the wall, which the window looks at: no half-space forbids it."""
    facing = box([-3, 8.0, 0], [10, 0.3, 6])
    case = room(facing, sides=("north",))
    assert reached(case, sun(180, 40)).mask.all()
    assert not reached(room(sides=("north",)), sun(180, 40)).mask.any()


def test_too_much_outside_to_tell_keeps_every_sun():
    many = {**box([-3, -9.0, 0], [0.1, 0.1, 0.1]), "count": [30, 4], "step": [0.2, 0.2]}
    assert reached(room(many, sides=("north",)), sun(180, 40)).mask.all()


@pytest.mark.parametrize("seed", range(6))
def test_what_is_left_out_has_no_light(seed):
    """All suns traced in random surroundings: those said not to get in have coefficients of 0."""
    rng = np.random.default_rng(seed)
    pieces, reflectance = [], 0.6 if seed % 3 == 0 else 0.0  # white ones hand most suns on
    for _ in range(rng.integers(1, 4)):
        across, away = rng.uniform(-12, 8), rng.uniform(3, 12)
        y = -away if rng.random() < 0.7 else 5 + away
        size = [*rng.uniform([2, 0.3, 1], [14, 3, 9])]
        pieces.append(box([across, y - size[1] * (y < 0), 0], size, reflectance))
    sides = tuple(rng.choice(["south", "north", "west"], rng.integers(1, 3), replace=False))
    case = room(*pieces, sides=sides, rotation=float(rng.uniform(-180, 180)))
    suns = np.array([sun(a, h) for a, h in rng.uniform([0, 2], [360, 80], (160, 2))])
    labels = tuple(f"sun_{i}" for i in range(len(suns)))
    diameter = 2.0
    C = simulation.transport(case, "open", Suns(labels, suns, diameter), 45.0)
    lit = C["replicates"].sel(bin=list(labels)).values.max(axis=(0, 1)) > 0
    mask = reached(case, *suns, diameter=diameter).mask
    assert not (lit & ~mask).any()
    assert lit.any()
    assert mask.all() if reflectance else not mask.all()
