"""Mirrors and clear solids of a model are components: photons follow their light."""

import json

import numpy as np
import pytest

from drcmitsuba.case.reading import load_case
from drcmitsuba.design.film_year import FilmYear
from drcmitsuba.model.materials import DielectricMaterial, MirrorMaterial
from drcmitsuba.model.radiance import bodies
from drcmitsuba.plan.planning import plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components import place
from drcmitsuba.scene.geometry import box, normals
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.daylight import daylight
from tests.model_rooms import l_room, layer
from tests.unit.model.box_room import obj_text


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


SILVER = MirrorMaterial(type="mirror", reflectance=0.9)
CLEAR = DielectricMaterial(type="dielectric", ior=1.5)
SQUARE = [(1, 1, 1), (2, 1, 1), (2, 2, 1), (1, 2, 1)]


def with_layers(*layers):
    case = l_room()
    building = case.building
    case._building = type(building)((*building.layers, *layers), north=building.north)
    return case


def test_a_mirror_has_ports_on_both_sides_and_a_solid_on_the_outside():
    case = with_layers(
        layer("silver", SILVER, SQUARE),
        layer("block", CLEAR, *box(np.ones(3), np.ones(3))),
    )
    silver, block = place(case)
    assert sorted(n[2] for n in normals(np.array([p.quad for p in silver.ports]))) == [-1, 1]
    n = normals(np.array([port.quad for port in block.ports]))
    middles = np.array([port.quad.mean(axis=0) for port in block.ports])
    assert len(n) == 6
    assert (np.einsum("pi,pi->p", n, 1.5 - middles) > 0).all()
    names = [surface.name for surface in surfaces_of(case)]
    assert names.count("silver") == names.count("block") == 1
    assert case.standing == ("silver", "block")


def test_a_body_of_many_faces_has_the_ports_of_its_box():
    (ball,) = place(with_layers(layer("ball", CLEAR, *bodies.sphere(np.full(3, 1.5), 0.3))))
    quads = np.array([port.quad for port in ball.ports])
    assert len(quads) == 6
    assert np.ptp(quads, axis=(0, 1)) == pytest.approx(0.6, abs=0.01)


MIRRORED = """
[model]
files = ["box.obj"]
unit = "m"
[materials.pane]
type = "glazing"
transmittance = 0.6
[materials.ceiling]
type = "mirror"
reflectance = 0.9
[model.reflectances]
wall = 0.5
floor = 0.2
[sensors]
floors = ["floor"]
spacing = 2.0
[period]
timestamps = "times.csv"
"""


def mirrored(folder, more=""):
    (folder / "box.obj").write_text(obj_text())
    (folder / "times.csv").write_text("time\n2015-03-20T10:00\n")
    (folder / "case.toml").write_text(MIRRORED + more)
    return load_case(folder / "case.toml")


def test_a_plan_follows_mirrors_of_a_model(tmp_path):
    case = mirrored(tmp_path)
    planned = plan(case, daylight(case))
    entry = planned.to_dict()["components"]
    assert entry["on"]
    assert "ceiling" in json.dumps(entry)


def test_the_year_of_a_film_refuses_mirrors_of_a_model(tmp_path):
    with pytest.raises(InputError, match="mesh of suns would blur"):
        mirrored(tmp_path, '[sun]\nmodel = "adaptive"\n')
    with pytest.raises(InputError, match='by way of "ceiling"'):
        FilmYear.of(mirrored(tmp_path))
