"""Transmittance of flat clear panes in closed form beside a search for them, ray by ray."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.sampling import transmittance

from drcmitsuba.case.case import Case
from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.runtime import backend
from drcmitsuba.scene import flat_panes, scene
from drcmitsuba.scene.flat_panes import FlatPanes
from drcmitsuba.scene.geometry import quad, reversed_quads

STRIPS = [
    {"bottom": 0.9, "top": 1.8, "material": "glass"},
    {"bottom": 1.8, "top": 2.6, "material": "dark"},
]
ROOM = {
    "room": {"size": [4.0, 5.0, 3.0]},
    "materials": {
        "glass": {"type": "glazing", "transmittance": 0.65},
        "dark": {"type": "glazing", "transmittance": 0.2, "ior": 1.52},
    },
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
    "facade": {
        "south": {"segments": 3, "frame": 0.1, "strips": STRIPS},
        "east": {"strips": STRIPS[:1]},
    },
}
LARGEST = 1e4


@pytest.fixture(autouse=True)
def _variant():
    backend.select()


def rays(low, high, count=1 << 16, seed=1):
    """Rays from points in and around a box, some of which end at a distance."""
    rng = np.random.default_rng(seed)
    o = rng.uniform(low - 2, high + 2, (count, 3))
    d = rng.standard_normal((count, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    ends = np.where(rng.random(count) < 0.5, LARGEST, rng.uniform(0, 6, count))
    at, towards = (mi.Float(np.ascontiguousarray(x.T.ravel(), np.float32)) for x in (o, d))
    at, towards = (np.asarray(x).reshape(3, -1) for x in (at, towards))
    return mi.Ray3f(mi.Point3f(*at), mi.Vector3f(*towards), mi.Float(ends), 0, [])


@pytest.mark.parametrize("turned", [0.0, 31.0])
def test_rays_from_anywhere_pass_what_a_search_finds(turned):
    case = Case.model_validate({**ROOM, "room": {**ROOM["room"], "rotation": turned}})
    world = scene.load(case)
    assert len(world.flat_panes.planes) == 3
    ray, active = rays(world.corners.min(axis=0), world.corners.max(axis=0)), mi.Bool(True)
    by_search = transmittance(world.clear, ray, active).numpy()
    in_closed_form = world.flat_panes.transmittance(ray, active).numpy()
    differ = abs(by_search - in_closed_form) > 2e-5
    assert differ.mean() < 1e-4  # rays at the very edge of a pane
    assert len(np.unique(by_search.round(3))) > 20
    assert ((by_search > 0) & (by_search < 0.1)).any()  # by two panes
    none = world.flat_panes.transmittance(ray, mi.Bool(False))
    assert float(dr.max(none)[0]) == 0


def test_what_is_not_flat_glass_is_searched_for():
    film = {"type": "bsdf", "file": str(shipped_folder() / "films/prism.xml")}
    film["straight_through"] = "on"
    with_film = {**ROOM, "materials": {**ROOM["materials"], "dark": film}}
    assert scene.load(Case.model_validate(with_film)).flat_panes is None
    without = scene.load(Case.model_validate({**ROOM, "facade": {}}))
    assert without.flat_panes is None
    assert without.clear is None


def test_few_parallel_rectangles_are_flat(monkeypatch):
    across, up = np.array([2.0, 0, 0]), np.array([0, 0, 1.5])
    first = quad(np.zeros(3), across, up)
    beside = first + [3.0, 0, 0.2]
    slanted = quad(np.zeros(3), across, up + [0.5, 0, 0])
    turned = quad(np.zeros(3), across + [0, 0, 0.5], up - [0.5, 0, 0])
    triangle = first[[0, 1, 2, 2]]
    lens = first[[0, 1, 2, 3]].copy()
    lens[2] = [1.2, 0, 1.5]

    def planes(*quads):
        made = FlatPanes.of([(np.array(quads), None)])
        return None if made is None else len(made.planes)

    assert planes(first) == planes(first, beside) == 1
    assert planes(first, first + [0, 0.01, 0]) == 2
    assert planes(first, reversed_quads(first[None])[0]) == 1  # glass of two sides
    assert planes(first, first + [0.5, 5e-4, 0]) is None  # one upon the other
    assert FlatPanes.of([(first[None], None), (first[None], None)]) is None
    assert len(FlatPanes.of([(first[None], None), (beside[None], None)]).planes) == 2
    for unfit in (slanted, turned, triangle, lens):
        assert planes(first, unfit) is None
    monkeypatch.setattr(flat_panes, "MOST_PANES", 1)
    assert planes(first, beside) is None
    monkeypatch.setattr(flat_panes, "MOST_PLANES", 1)
    assert planes(first, first + [0, 1.0, 0]) is None
