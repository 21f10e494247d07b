"""Components that do not fit are refused, and so is what cannot follow them."""

import pytest

from drcmitsuba.annual import attributes
from drcmitsuba.annual.tradeoff import tradeoff
from drcmitsuba.design.film_year import FilmYear
from drcmitsuba.design.layout import Layout
from drcmitsuba.design.reflectances import Interior
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import components
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from tests import ROOT
from tests.unit.scene.component_cases import (
    CUBE,
    DUCT,
    MATERIALS,
    PIPE,
    PRISM,
    SLATS,
    case,
    with_mesh,
    with_strip,
)


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"components": {"pipe": PIPE | {"mirror": "glass"}}},
         "components.pipe.mirror: \"glass\" is no mirror"),
        ({"components": {"pipe": PIPE | {"bottom": "silver"}}},
         "pipe.bottom: \"silver\" is no glazing or diffuser"),
        ({"components": {"pipe": PIPE | {"sides": 6}}}, "sides"),
        ({"components": {"glass": PIPE}}, "components.glass: the name is taken"),
        ({"components": {"pipe": PIPE}, "room": None}, "components.pipe: there is no room"),
        ({"components": {"pipe": PIPE},
          "facade": {"south": {"strips": [{"bottom": 1, "top": 2, "material": "pipe"}]}}},
         "no pane is made of \"pipe\""),
        ({"facade": {"south": {"strips": [{"bottom": 1, "top": 2, "material": "silver"}]}}},
         "no pane is made of \"silver\""),
        ({"materials": MATERIALS | {"silver": MATERIALS["silver"]
                                    | {"coating": 1.5, "roughness": 0.1}}},
         "coating: with a roughness of 0.1"),
    ],
)  # fmt: skip
def test_tables_that_do_not_fit_are_refused(tables, message):
    with pytest.raises(ValueError, match=message):
        case(**tables)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        (
            {"pipe": PIPE | {"centre": [0.2, 2.0]}},
            "pipe: its hole, -0.05 to 0.45 .* leaves the ceil",
        ),
        ({"duct": DUCT | {"length": 5.2}}, "duct: its hole, .* leaves the ceiling"),
        ({"duct": DUCT | {"length": 0.3}}, "duct.length: 0.3 m, but entry and bend take"),
        ({"duct": DUCT | {"above": 0.001}}, "duct.above: 0.001 m; give at least"),
        ({"pipe": PIPE | {"height": 0.01}}, "pipe.height: 0.01 m; give at least 0.04 m"),
        ({"a": PIPE, "b": PIPE | {"centre": [2.3, 2.5]}}, "components.b: it runs into a"),
        ({"a": PIPE | {"centre": [2.0, 1.0]}, "b": DUCT}, "components.b: it runs into a"),
    ],
)
def test_holes_that_do_not_fit_are_refused(tables, message):
    with pytest.raises(InputError, match=message):
        components.place(case(components=tables))


def test_a_port_in_furniture_is_refused():
    box = {"name": "cupboard", "corner": [1, 1, 2], "size": [2, 3, 1.5]}
    with pytest.raises(InputError, match=r"pipe.ports.1: it lies in 'cupboard'"):
        components.place(case(components={"pipe": PIPE}, furniture=[box]))


@pytest.mark.parametrize(
    ("text", "changes", "message"),
    [
        (PRISM, {"tilt": 10.0}, "panel.tilt: the recipe is of kind prism"),
        (PRISM + "[glass]\ntransmittance = 0.9\ndistance = 8\n", {"outer": "glass"},
         "panel.outer: the recipe has its own"),
        (SLATS, {"gap": 0.0005}, "panel.gap: rays would skip 0.5 mm of air"),
        (SLATS.replace("40", "2"), {}, "a period of 2 mm is too fine"),
        (SLATS.replace("40", "1400"), {}, "structure.period: a period takes 1400 mm"),
    ],
)  # fmt: skip
def test_structures_that_do_not_fit_are_refused(tmp_path, text, changes, message):
    with pytest.raises(InputError, match=message):
        components.place(with_strip(tmp_path, text, **changes))


TASKS = {
    "film": FilmYear.of,
    "interior": lambda room: Interior.of(room, None),
    "tradeoff": tradeoff,
}


def test_the_year_of_a_film_refuses_components():
    room = case(
        components={"pipe": PIPE},
        facade={"south": {"strips": [{"bottom": 1, "top": 2, "material": "glass"}]}},
        design={"film": "opal"},
    )
    with pytest.raises(InputError, match='a film counts no light by way of "pipe"'):
        FilmYear.of(room)
    assert "counts no light by way of them" in (ROOT / "docs" / "limits.md").read_text()


@pytest.mark.parametrize("task", [*TASKS, "optimise"])
def test_what_follows_no_choice_of_effects_refuses_one(task):
    room = case(
        facade={"south": {"strips": [{"bottom": 1, "top": 2, "material": "glass"}]}},
        design={"film": "opal"},
        effects={"suns": "all", "pictures": "off"},
    )
    with pytest.raises(InputError, match=r"effects\.suns: .*; leave it"):
        {**TASKS, "optimise": Layout.of}[task](room)


def test_a_search_takes_components_beside_its_strips_and_refuses_those_in_them(tmp_path):
    beside = case(
        components={"pipe": PIPE},
        facade={"south": {"strips": [{"bottom": 1, "top": 2, "material": "glass"}]}},
        design={"film": "opal"},
    )
    assert Layout.of(beside).film == "opal"
    within = with_strip(tmp_path, SLATS).with_tables(design=beside.design)
    with pytest.raises(InputError, match="stands in a strip that tiles would cut"):
        Layout.of(within)


def test_the_fingerprint_follows_recipes_and_meshes(tmp_path):
    slats, cube = with_strip(tmp_path, SLATS), with_mesh(tmp_path)
    before = attributes.fingerprint(slats, ALL_EFFECTS), attributes.fingerprint(cube, ALL_EFFECTS)
    (tmp_path / "recipe.toml").write_text(SLATS.replace("0.9", "0.8"), encoding="utf-8")
    (tmp_path / "mesh.obj").write_text(CUBE.replace("v 0 0 0", "v 0 0 0.1"), encoding="utf-8")
    after = attributes.fingerprint(slats, ALL_EFFECTS), attributes.fingerprint(cube, ALL_EFFECTS)
    assert not set(before) & set(after)
    assert attributes.fingerprint(with_strip(tmp_path, SLATS, tilt=11.0), ALL_EFFECTS) != before[0]
