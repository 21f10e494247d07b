"""Façades put together from elements against simulations of each façade, in many kinds of cases."""

from dataclasses import replace

import numpy as np
import pytest

import drcmitsuba
from drcmitsuba.annual import simulation
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from tests import ROOT
from tests.model_rooms import house
from tests.unit.transport.exact_scenes import CLOTH, GLASS, OPAL

pytestmark = pytest.mark.slow
FILM = {"type": "bsdf", "file": str(ROOT / "scenes" / "films" / "prism.xml")}
FINE = {"replicates": 24, "paths": 1024, "sensor_sky_rays": 2048, "cell_size": 0.2}
BASE = {
    "site": {"latitude": 46.2, "longitude": 6.1, "timezone": 1},
    "period": {"months": [3, 6, 12], "days_per_week": 1},
    "room": {"size": [4.0, 5.0, 3.0], "floor": 0.3, "walls": 0.6, "ceiling": 0.8},
    "materials": {"glass": GLASS, "opal": OPAL, "cloth": CLOTH, "film": FILM},
    "sensors": {"corner": [0.5, 0.6, 0.8], "count": [3, 4], "spacing": 1.1},
    "accuracy": FINE,
}
COLOURED = {"size": [4.0, 5.0, 3.0], "floor": [0.4, 0.2, 0.1], "walls": 0.6, "ceiling": 0.8}
HOUSE = {"name": "house", "corner": [-3, -8, 0], "size": [10, 1, 6], "reflectance": 0.5}


SOFFIT = {"name": "balcony", "corner": [0, -0.36, 3.0], "size": [4, 0.36, 0.1], "reflectance": 0.35}


def strips(*materials):
    edges = np.linspace(0.9, 2.7, len(materials) + 1).round(3).tolist()
    rows = zip(edges, edges[1:], materials, strict=False)
    return {"strips": [{"bottom": b, "top": t, "material": m} for b, t, m in rows]}


def case(facade, **tables):
    return Case.model_validate({**BASE, "name": "case", "facade": facade, **tables})


def drawn(one, choice):
    """The case with the panes of openings "material (side)" drawn as a choice has them."""
    facade = dict(one.facade)
    for opening, fill in choice.items():
        material, side = opening.removesuffix(")").split(" (")
        material, fill = material, "open" if fill == "hole" else fill
        every = tuple(
            s.model_copy(update={"material": fill}) if s.material == material else s
            for s in facade[side].strips
        )
        facade[side] = facade[side].model_copy(update={"strips": every})
    return one.with_tables(facade=facade)


def replicates(light, one, choice, panes=False, state="open"):
    """C by each replicate: of the choice by elements, and of the case by a simulation."""
    facade, _ = light._fixed(choice)
    ours = facade.state("open", None, lambda share: None)
    planned = plan(one, light.daylight)
    scope = replace(planned.scope, pane_to_pane=panes and planned.scope.pane_to_pane)
    run = replace(Run.of(one, scope), seed=99)
    latitude = light.daylight.sky.attrs["latitude"]
    theirs = simulation.transport(one, state, light.daylight.suns, latitude, run=run)
    return tuple(C["replicates"].transpose("replicate", ...).values for C in (ours, theirs))


@pytest.fixture(scope="module", autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def same_sums(same, ours, theirs, within, sun_within):
    """Compare light of all of the sky, and of all suns, sensor by sensor and in sum."""
    for bins, limit in ((slice(0, 146), within), (slice(146, None), sun_within)):
        same(ours[..., bins].sum(axis=-1), other=theirs[..., bins].sum(axis=-1), within=limit)


@pytest.mark.parametrize(
    ("facade", "fills", "choices", "tables"),
    [
        ({"south": strips("glass")}, ["cloth", "hole"],
         [{}, {"glass (south)": "cloth"}, {"glass (south)": "hole"}], {}),
        ({"south": strips("glass")}, ["film"], [{"glass (south)": "film"}], {}),
        ({"south": strips("glass", "film")}, ["cloth"],
         [{}, {"glass (south)": "cloth"}, {"film (south)": "cloth"}], {}),
        ({"south": strips("glass")}, ["cloth"], [{}, {"glass (south)": "cloth"}],
         {"furniture": [HOUSE]}),
        ({"south": strips("glass")}, ["film"], [{"glass (south)": "film"}], {"furniture": [HOUSE]}),
        ({"south": strips("glass")}, ["cloth"], [{"glass (south)": "cloth"}], {"room": COLOURED}),
        # No cell lies on the ceiling and on the soffit that goes on from it.
        ({"south": {"strips": [{"bottom": 0.9, "top": 2.95, "material": "film"}]}}, ["opal"],
         [{}, {"film (south)": "opal"}], {"furniture": [SOFFIT]}),
    ],
    ids=["box", "film", "film beside glass", "house opposite", "film and house", "coloured",
         "soffit"],
)  # fmt: skip
def test_choices_are_simulations(same, facade, fills, choices, tables):
    one = case(facade, **tables)
    light = drcmitsuba.elements(one, fills)
    for choice in choices:
        same_sums(same, *replicates(light, drawn(one, choice), choice), 0.006, 0.006)


@pytest.mark.parametrize(
    ("facade", "fills", "choices"),
    [
        ({"south": strips("glass"), "west": strips("glass")}, ["cloth", "hole"],
         [{}, {"glass (south)": "cloth"}, {"glass (west)": "hole"}]),
        ({"south": strips("glass"), "north": strips("opal")}, [], [{}]),
        ({side: strips("glass") for side in ("south", "west", "north")}, [], [{}]),
    ],
    ids=["corner", "milk glass opposite", "three sides"],
)  # fmt: skip
def test_glass_mirrors_light_of_other_openings(same, facade, fills, choices):
    """A simulation follows light from pane to pane by photons, and by images of the suns."""
    one = case(facade)
    light = drcmitsuba.elements(one, fills)
    assert len(light.channels[0].pairs)
    for choice in choices:
        ours, theirs = replicates(light, drawn(one, choice), choice, panes=True)
        same_sums(same, ours, theirs, 0.006, 0.004)


@pytest.mark.parametrize("name", ["duct/duct", "lamella/lamella"])
def test_components_are_part_of_elements(same, name):
    """Photons are few: the suns' light of single sensors is known to some per cent."""
    one = drcmitsuba.load_case(ROOT / "scenes" / f"{name}.toml")
    fewer = one.period.model_copy(update={"months": (3,), "days_per_week": 1})
    one = one.with_tables(period=fewer)
    light = drcmitsuba.elements(one)
    same_sums(same, *replicates(light, one, {}), 0.005, 0.005)


def test_a_model_of_three_rooms_with_a_roof_light(same, tmp_path):
    (tmp_path / "house.rad").touch()  # a digest of it is part of what made C
    one = house(
        model={"files": [str(tmp_path / "house.rad")]},
        materials={"cloth": CLOTH},
        groups={"south": {"panes": ["glass"], "facing": "south", "states": ["cloth"]}},
        sensors={"floors": ["floor"], "spacing": 1.5},
        accuracy=FINE,
        period=BASE["period"],
    )
    light = drcmitsuba.elements(one)
    assert len(light.openings) == 2
    for fill, state in (("glass", "open"), ("cloth", "cloth/open")):
        same_sums(same, *replicates(light, one, {"south": fill}, state=state), 0.006, 0.01)


def test_light_between_films_of_a_corner_is_left_out_by_so_much():
    """The sum lacks light from pane to pane, and counts what a film throws back as even."""
    one = case({"south": strips("glass"), "west": strips("glass")})
    light = drcmitsuba.elements(one, ["film"])
    choice = {"glass (south)": "film", "glass (west)": "film"}
    ours, theirs = replicates(light, drawn(one, choice), choice, panes=True)
    for bins, most in ((slice(0, 146), 0.02), (slice(146, None), 0.02)):
        a, b = (x[..., bins].sum(axis=(1, 2)) for x in (ours, theirs))
        error = np.hypot(*(x.std(ddof=1) / len(x) ** 0.5 for x in (a, b))) / b.mean()
        off = a.mean() / b.mean() - 1
        print(f"sum off by {off:+.2%} ± {error:.2%}")
        assert error < 0.005
        assert -most < off < 0.005
