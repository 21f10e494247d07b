"""Compositions as cases that can be built, and what a design poses: layouts and their errors."""

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.design.layout import Layout
from drcmitsuba.design.realise import realise
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked
from drcmitsuba.scene.surfaces import surfaces_of
from tests.synthetic_year import MATERIALS, SyntheticYear, Tiles

WALL = 8.8 * 3.6


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


@pytest.fixture(scope="module")
def year():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    return SyntheticYear(Tiles.grid(6, 6), time=120, grid=(4, 6))


TABLES = {
    "room": {"size": [8.8, 9.0, 3.6]},
    "materials": {
        "glass": {"type": "glazing", "transmittance": 0.65},
        "film": {"type": "diffuser", "transmittance": 0.5},
        "shade": {"type": "diffuser", "transmittance": 0.1},
    },
    "facade": {
        "south": {
            "segments": 6,
            "strips": [{"bottom": 0.9, "top": 2.7, "material": "glass"}],
        }
    },
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [4, 6], "spacing": 1.0},
    "shading": {"material": "shade"},
    "design": {"film": "film"},
}


def case(facade=None, **design):
    tables = TABLES | {"design": {"film": "film"} | design}
    if facade is not None:
        tables["facade"] = {"south": TABLES["facade"]["south"] | facade}
    return checked(Case, tables, "room.toml")


def pane_area(built, name):
    quads = [s.quads for s in surfaces_of(built) if s.name == f"{name} south"]
    return sum(
        np.linalg.norm(np.cross(q[:, 1] - q[:, 0], q[:, 3] - q[:, 0]), axis=1).sum() for q in quads
    )


def test_a_built_façade_has_the_areas_of_its_composition():
    rng = np.random.default_rng(0)
    tiles = Tiles.grid(4, 6)
    share = np.zeros((24, 4))
    share[:, :3] = rng.dirichlet([1, 1, 1], 24)
    built = realise(case(), "south", tiles, share, MATERIALS, "film")
    for i, name in ((1, "glass"), (2, "film")):
        assert pane_area(built, name) == pytest.approx(tiles.area @ share[:, i], rel=5e-3)


def test_pieces_lie_where_their_neighbours_say():
    tiles = Tiles.grid(3, 6)
    share = np.zeros((18, 4))
    share[:6] = [0.5, 0.5, 0, 0]  # the sill lies in the lowest row
    share[6:12] = [0, 0.4, 0.6, 0]
    share[12:] = [0.25, 0, 0.75, 0]  # and the head in the highest
    strips = realise(case(), "south", tiles, share, MATERIALS, "film").facade["south"].strips
    assert [(s.material, s.segments) for s in strips] == [("glass", None), ("film", None)]
    np.testing.assert_allclose([(s.bottom, s.top) for s in strips], [(1.2, 1.74), (1.74, 2.55)])
    share[:6], share[12:] = [0, 0, 1, 0], [0, 1, 0, 0]  # film below: it stays below
    strips = realise(case(), "south", tiles, share, MATERIALS, "film").facade["south"].strips
    assert [s.material for s in strips] == ["film", "glass"]
    np.testing.assert_allclose(strips[0].top, 1.5 + 0.36)


def test_a_window_alone_in_its_wall_lies_in_the_middle_of_its_tile():
    tiles = Tiles.grid(3, 6)
    share = np.tile([1.0, 0, 0, 0], (18, 1))
    share[6:12] = [0.5, 0.3, 0.2, 0]  # tiles from 1.5 to 2.1 m
    strips = realise(case(), "south", tiles, share, MATERIALS, "film").facade["south"].strips
    assert [(s.material, s.segments) for s in strips] == [("glass", None), ("film", None)]
    np.testing.assert_allclose([(s.bottom, s.top) for s in strips], [(1.65, 1.83), (1.83, 1.95)])


def test_whole_tiles_are_the_variant_that_they_come_from():
    tiles = Tiles.grid(2, 6)
    share = np.zeros((12, 4))
    share[:6, 1], share[6:, 2] = 1, 1
    built = realise(case({"frame": 0.1}), "south", tiles, share, MATERIALS, "film")
    strips = built.facade["south"].strips
    assert [(s.bottom, s.top, s.material) for s in strips] == [
        (0.9, 1.8, "glass"),
        (1.8, 2.7, "film"),
    ]
    assert built.source == case().source


def test_mixed_segments_and_finer_tiles_become_segments():
    tiles = Tiles.grid(1, 12)
    share = np.zeros((12, 4))
    share[::2, 1], share[1::2, 2] = 1, 1
    facade = realise(case(), "south", tiles, share, MATERIALS, "film").facade["south"]
    assert facade.segments == 12
    assert {s.material: s.segments for s in facade.strips} == {
        "glass": tuple(range(0, 12, 2)),
        "film": tuple(range(1, 12, 2)),
    }
    odd = Tiles(np.array([[0.0, 1.0, 0.9, 2.7], [1.0, 8.8, 0.9, 2.7]]))
    with pytest.raises(InputError, match=r"design: tiles: tiles of 1 m in a façade of 8\.8 m"):
        realise(case({"segments": 200}), "south", odd, share[:2], MATERIALS, "film")


def test_pieces_too_low_for_their_frame_go_to_their_neighbours():
    tiles = Tiles.grid(1, 6)
    share = np.tile([0.0, 0.96, 0.04, 0.0], (6, 1))
    built = realise(case({"frame": 0.1}), "south", tiles, share, MATERIALS, "film")
    assert [(s.bottom, s.top, s.material) for s in built.facade["south"].strips] == [
        (0.9, 2.7, "glass")
    ]


def test_a_layout_takes_what_is_left_open_from_the_case():
    layout = Layout.of(case())
    assert (layout.side, layout.clear, layout.film) == ("south", "glass", "film")
    assert (layout.band, layout.rows, layout.segments) == ((0.9, 2.7), 6, 6)
    assert layout.wwr == pytest.approx((0.5, 0.5))
    assert Layout.of(case(row_height=0.1, segments=3)).rows == 18
    assert Layout.of(case(band=[0.6, 3.0], wwr=[0.2, 0.9])).wwr == pytest.approx((0.2, 2.4 / 3.6))


def test_a_layout_poses_its_problem(year):
    problem = Layout.of(case(ase_limit=20.0)).problem(year)
    assert [p.key for p in problem.free] == ["dwr", "position"]
    assert problem.goal.ase_limit == 20.0
    share = problem.evaluate(problem.start, 8.0).share
    assert year.tiles.area @ (1 - share[:, 0]) == pytest.approx(0.5 * WALL, rel=1e-5)
    strips = Layout.of(case(parameters="strips")).problem(year)
    assert strips.size == 36  # the window fills its band: only the film is free
    both = Layout.of(case(parameters="strips", wwr=[0.3, 0.4])).problem(year)
    assert both.size == 72
    assert both.goal.window_area == pytest.approx((0.3 * WALL, 0.4 * WALL))
    turned = Layout.of(case(shade_vlt=[0.05, 0.2], glazing_transmittance=[0.4, 0.65]))
    factors = turned.problem(year).factors
    assert [(f.now, f.parameter.low, f.parameter.high) for f in factors] == [
        ({"glass": 0.65}, 0.4, 0.65),
        ({"shade": 0.1}, 0.05, 0.2),
    ]


def test_strips_are_tried_first_as_a_designer_would(year):
    layout = Layout.of(case(parameters="strips", wwr=[0.3, 0.4], shade_vlt=[0.05, 0.2]))
    problem = layout.problem(year)
    films = []
    own, *others = layout.known(problem)
    values = problem.named(own)
    assert (values["window"] == 1).all()
    assert (values["film"] == 0).all()
    for x in others:
        values = problem.named(x)
        np.testing.assert_allclose(values["window"], 0.6)
        np.testing.assert_allclose(values["shade_vlt"], 0.1)
        films.append([i for i in range(6) if values["film"].reshape(6, 6)[i].all()])
    assert films == [[], list(range(6)), [3, 4, 5], [0, 1, 2], [2, 3]]
    window = Layout.of(case())
    assert len(window.known(window.problem(year))) == 1


@pytest.mark.parametrize(
    ("design", "line"),
    [
        ({"film": "prisms"}, 'design.film: "prisms" is no such material in [materials]; choose '
         'from: "film", "shade"'),
        ({"film": "glass"}, 'design.film: "glass" is no such material in [materials]; choose '
         'from: "film", "shade"'),
        ({"clear": "glas"}, 'design.clear: "glas" is no such material in [materials]; did you '
         'mean "glass"?'),
        ({"band": [0.9, 4.0]}, "design.band: the room is 3.6 m high; lower its upper edge"),
        ({"band": [2.0, 1.0]}, "design.band: 2 to 1; give the lower value first"),
        ({"side": "north"}, "design.side: the north side has no panes; give band and wwr = "
         "[low, high]"),
        ({"rows": 3, "row_height": 0.1}, "design.row_height: rows are given too; give one of them"),
        ({"wwr": [0.6, 0.2]}, "design.wwr: 0.6 to 0.2; give the lower value first"),
        ({"objective": "area"}, "design.sda_least: the objective is the least area, of which "
         "nothing is asked; give the least sDA [%], sda_least = 55, or the name of a standard"),
        ({"sda_least": 55}, "design.sda_least: the objective is sDA; leave it out, or give "
         'objective = "area"'),
        ({"starts": 0}, "design.starts: got 0; input should be greater than or equal to 1"),
        ({"strips": 3}, "design.strips: unknown key; remove it"),
    ],
)  # fmt: skip
def test_a_wrong_design_is_refused_with_a_remedy(design, line):
    with pytest.raises(InputError) as caught:
        case(**design)
    assert str(caught.value) == f"room.toml: {line}"


GLASS = {"type": "glazing", "transmittance": 0.65}
FABRIC = {"type": "diffuser", "transmittance": 0.1}


@pytest.mark.parametrize(
    ("changed", "design", "line"),
    [
        ({"glass": GLASS | {"ior": 1.52}}, {"glazing_transmittance": [0.4, 0.6]},
         'glazing_transmittance: "glass": by its refractive index, each angle changes in its own'),
        ({"shade": FABRIC | {"straight": 0.05}}, {"shade_vlt": [0.05, 0.2]},
         'shade_vlt: "shade": light goes straight through it, too; leave out straight'),
        ({"shade": FABRIC | {"transmittance": [0.05, 0.1]}}, {"shade_vlt": [0.05, 0.2]},
         'shade_vlt: "shade": its transmittance is not known'),
        ({"glass": GLASS | {"reflectance": 0.2}}, {"glazing_transmittance": [0.4, 0.9]},
         "glazing_transmittance: up to 0.9: 0.9 + 0.2 is above 1; lower its end"),
        ({}, {"shade_vlt": [0.05, 0.2]}, "shade_vlt: no shade: its transmittance is not known"),
    ],
)  # fmt: skip
def test_a_transmittance_that_is_no_factor_of_light_is_refused(changed, design, line):
    """Before any light is traced."""
    tables = TABLES | {"design": {"film": "film"} | design}
    tables["materials"] = TABLES["materials"] | changed
    if not changed:
        tables.pop("shading")
    with pytest.raises(InputError) as caught:
        Layout.of(checked(Case, tables, "room.toml"))
    assert str(caught.value).startswith(f"case: design.{line}")


def test_a_tilt_has_no_area():
    tables = {"component": "lamellae", "objective": "area", "sda_least": 55}
    with pytest.raises(InputError, match="sda_least: the tilt of a component is searched"):
        checked(Design, tables, "room.toml")
    del tables["sda_least"]
    with pytest.raises(
        InputError, match="objective: the tilt of a component is searched by sDA or msDA"
    ):
        checked(Design, tables, "room.toml")


def test_a_design_that_cannot_be_is_refused():
    with pytest.raises(InputError, match="design: no such table; add"):
        Layout.of(checked(Case, {k: v for k, v in TABLES.items() if k != "design"}, "room.toml"))
    with pytest.raises(InputError, match=r"ratio of 0\.6, the band has 0\.5; give a wider"):
        Layout.of(case(wwr=[0.6, 0.7]))
