"""Pictures of a state as a sum over elements, against the same façade traced as it is drawn.

By element, rays of the eye meet one fill in all openings, one fill after another, and paths between
surfaces draw the fill of every opening; a state is a sum over slots and marks. The reference knows
no elements: one scene, in which the panes are those of the state, with random numbers of its own.
"""

import dataclasses

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba import InputError
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.schedule import HOURS
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering import Sampling, frames, prepare
from drcmitsuba.rendering.asked_view import effects_of_view
from drcmitsuba.rendering.coefficient_pictures import coefficient_pictures
from drcmitsuba.rendering.hour import luminance, replicates
from drcmitsuba.rendering.light_paths import trace
from drcmitsuba.rendering.view_facade import ViewFacade
from drcmitsuba.rendering.view_of_case import in_the_scene
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport.elements.marks import BITS, elements_of, share_of
from tests.fast import slowly
from tests.model_rooms import house
from tests.unit.colour.rooms import box
from tests.unit.glare_year.test_glare_of_films import klems
from tests.unit.rendering.path_traced import LUMINANCES, Patchwise
from tests.unit.scene.test_groups_of_models import case as shelf

SUN = np.array([0.5, -0.6, 0.62]) / np.linalg.norm([0.5, -0.6, 0.62])
NOON, SIZE, REGIONS = "03-20 12:00", 9, 3
GLASS = {"type": "glazing", "transmittance": 0.6, "reflectance": 0.1}
CLOTH = {"type": "diffuser", "transmittance": 0.1, "reflectance": 0.5}
VIEW = PictureView("equidistant", (0.5, -1, -0.1), (0, 0, 1), (170, 170), (1.0, 3.2, 1.3))
DESK = {"desk": {"position": [2.0, 3.5, 1.2], "direction": [0, -1, 0]}}


def outside(sun=1e8):
    return Patchwise(np.zeros((2, 2)), 0.0, sun, SUN, 0.5)


def strips(*materials):
    """Strips of a side, one above the other."""
    ends = np.linspace(0.9, 2.7, len(materials) + 1).round(2).tolist()
    each = zip(ends, ends[1:], materials, strict=False)
    return {"strips": [{"bottom": a, "top": b, "material": name} for a, b, name in each]}


def corner(south="glass", east="glass", **tables):
    """Room with windows to the south and the east, each in a group of two states."""
    glazed = [side for side, name in (("south", south), ("east", east)) if name == "glass"]
    groups = {side: {"panes": ["glass"], "facing": side, "states": ["cloth"]} for side in glazed}
    return box(
        facade={"south": strips(south), "east": strips(east)},
        materials={"glass": GLASS, "cloth": CLOTH}, groups=groups,
        effects={"pane_to_pane": "off"}, **tables,
    )  # fmt: skip


def beside(above):
    """Room with glass below something else; the shade covers the glass alone."""
    return box(
        facade={"south": strips("glass", "above")}, shading={"material": "cloth"},
        materials={"glass": GLASS, "cloth": CLOTH, "above": above},
    )  # fmt: skip


def beside_a_film(folder):
    return beside({"type": "bsdf", "file": str(klems(folder, through=0.2))})


def beside_opal_glass(folder):
    return beside({"type": "diffuser", "transmittance": 0.3, "reflectance": 0.4})


def films(folder):
    """Room whose two sides may have a film in place of glass: light goes from film to film."""
    film = {"type": "bsdf", "file": str(klems(folder, through=0.2))}
    case = corner()
    groups = {side: {"panes": ["glass"], "facing": side, "states": ["film"]}
              for side in ("south", "east")}  # fmt: skip
    data = case.model_dump(exclude={"effects"}) | {
        "materials": {"glass": GLASS, "film": film},
        "groups": groups,
    }
    return type(case).model_validate(data)


def two_rooms(folder):
    """Two rooms side by side below a third one, whose roof light is a group of its own."""
    return house(materials={"cloth": CLOTH}, shading={"material": "cloth", "groups": "facing"})


def traced(facade, seed, *, fills=(), samples=256, pane_to_pane=False):
    """View of a façade, by element where it is open to choice."""
    effects = dataclasses.replace(
        effects_of_view(facade, fills, SIZE**2), pane_to_pane=pane_to_pane
    )
    return trace(
        facade.scenes(-1, effects), in_the_scene(facade.case, VIEW),
        SIZE, SIZE, sampling=Sampling(samples, paths=8, sky=8, panes=8), subdivision=1,
        diameter=0.5, accuracy=Accuracy(replicates=8, seed=seed, cell_size=0.4),
    )  # fmt: skip


def agree(ours, theirs, within=0.005):
    """Assert that regions of two pictures (replicate, row, column) agree within both errors."""
    step, parts = SIZE // REGIONS, []
    for L in (ours, theirs):
        by_region = L.reshape(-1, REGIONS, step, REGIONS, step).mean(axis=(2, 4))
        each = np.column_stack([by_region.reshape(len(L), -1), L.mean(axis=(1, 2))])  # and the mean
        parts.append((each.mean(axis=0), each.std(axis=0, ddof=1) / np.sqrt(len(L))))
    (here, own), (there, other) = parts
    error = np.hypot(own, other)
    print((here / there - 1).round(3).tolist(), (error / there).round(3).tolist())
    assert (abs(here - there) < 4 * error + within * there).all()
    assert (error < 0.05 * there).all()
    assert error[-1] < 0.02 * there[-1]


ROOMS = {
    "one of two groups closed": (lambda folder: corner(), "cloth/open"),
    "shade over glass beside opal glass": (beside_opal_glass, "shaded"),
    "shade over glass beside a film": (beside_a_film, "shaded"),
    "a film in one of two windows": (films, "film/open"),
    "rooms of a model": (two_rooms, "shaded/open"),
}


SLOW = [name for name in ROOMS if any(x in name for x in ("film", "model", "groups"))]


@pytest.mark.parametrize("name", slowly(ROOMS, *SLOW))
def test_a_state_is_that_of_its_own_light_paths(name, tmp_path):
    make, state = ROOMS[name]
    case = make(tmp_path)
    facade = ViewFacade.of(case, "open")
    indices = facade.indices(state, {}, daylight(case))
    drawn = ViewFacade(case, state, None)  # light paths of this state alone
    ours, theirs = (traced(each, seed, pane_to_pane=name.startswith("a film"))
                    for each, seed in ((facade, 3), (drawn, 5)))  # fmt: skip
    agree(*(replicates(view, outside(), LUMINANCES)
            for view in (ours.in_state(indices), theirs.in_state())))  # fmt: skip


def test_further_fills_are_those_of_a_case_drawn_so():
    case, fills = corner(east="wall"), {"south": ["hole", "wall"]}
    facade, light = ViewFacade.of(case, "open", fills), daylight(case)
    view = traced(facade, 3, fills=fills)
    drawn = ViewFacade.of(corner("open", "wall"), "open")
    there = replicates(traced(drawn, 5).in_state(), outside(), LUMINANCES)
    hole = view.in_state(facade.indices("open", {"south": "hole"}, light))
    agree(replicates(hole, outside(), LUMINANCES), there)
    walled = view.in_state(facade.indices("shaded", {"south": "wall"}, light))
    assert replicates(walled, outside(), LUMINANCES).max() == 0


def test_coefficient_pictures_of_a_state_sum_up_to_the_sky_of_an_hour():
    case = corner()
    facade = ViewFacade.of(case, "open")
    indices = facade.indices("cloth/open", {}, daylight(case))
    view = traced(facade, 3, samples=16).in_state(indices)
    (whole,) = coefficient_pictures(view)
    shown = luminance(view, outside(0.0), LUMINANCES).mean
    assert np.allclose(whole["coefficient"].values @ LUMINANCES, shown, rtol=1e-4)


def test_a_view_shows_states_and_choices_without_another_trace(monkeypatch):
    desk = prepare(corner(views=DESK), size=12, sampling=Sampling(paths=4))
    assert desk.fills == {"south": ("glass", "cloth"), "east": ("glass", "cloth")}
    monkeypatch.setattr("drcmitsuba.rendering.light_paths.gather", None)  # tracing would call it
    is_open, shut = (desk.at(NOON, state=state).picture.luminance for state in ("open", "shaded"))
    assert shut.mean() < 0.5 * is_open.mean()
    one = desk.at(NOON, state="open/cloth")
    same = desk.at(NOON, choice={"east": "cloth"})
    assert (one.state, same.state) == ("open/cloth", "open, east cloth")
    assert np.allclose(one.picture.rgb, same.picture.rgb, rtol=1e-5)
    assert shut.mean() < one.picture.luminance.mean() < is_open.mean()
    again = desk.at(NOON, state="shaded", choice={"south": "glass"})
    assert np.allclose(one.picture.rgb, again.picture.rgb, rtol=1e-5)


@pytest.mark.parametrize(
    ("asked", "line"),
    [
        ({"state": "ajar"}, ".ajar. for 2 groups"),
        ({"choice": {"north": "cloth"}}, "no opening"),
        ({"choice": {"south": "paper"}}, "no fill"),
        ({"choice": {"south": {"glass": 0.5, "cloth": 0.5}}}, "shares of fills, which a picture"),
    ],
)
def test_what_is_no_state_or_fill_is_refused(asked, line):
    case = corner(views=DESK)
    facade, light = ViewFacade.of(case, "open"), daylight(case)
    with pytest.raises(InputError, match=line):
        facade.indices(**({"state": "open", "choice": {}} | asked), light=light)


def test_a_facade_that_is_not_by_element_has_one_state():
    case = corner(views=DESK)
    alone = ViewFacade(case, "cloth/open", None)
    assert alone.indices("cloth/open", {}, daylight(case)) == ()
    with pytest.raises(InputError, match="prepare the view in this state"):
        alone.indices("open", {}, daylight(case))
    bare = box(views=DESK)
    assert ViewFacade.of(bare, "shaded").panes is None
    assert ViewFacade.of(bare, "open", {"glass (south)": []}).fills == {}


def test_states_with_surfaces_of_their_own_are_traced_one_by_one(tmp_path):
    """A shelf becomes brighter as its group's panes become darker: no opening tells of it."""
    hours = HOURS // 2
    (tmp_path / "south.csv").write_text("south\n" + "open\n" * hours + "dark\n" * hours)
    view = "[views.desk]\nposition = [2, 2, 1.5]\ndirection = [0, -1, 0]\n"
    case = shelf(tmp_path, f'[groups.south]\nschedule = "south.csv"\n{view}')
    times, kind = (NOON, "09-20 12:00"), {"size": 8, "state": "applied", "folder": tmp_path / "out"}
    shown = list(frames(case, "desk", times, **kind))
    assert [frame.state for frame in shown] == ["open", "dark"]
    assert 0 < shown[1].picture.luminance.mean() < 0.5 * shown[0].picture.luminance.mean()
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["desk_dark_light_paths", "desk_open_light_paths"]


def test_one_state_is_traced_alone(tmp_path):
    case, kind = corner(views=DESK), {"size": 8, "sampling": Sampling(paths=4), "folder": tmp_path}
    alone = prepare(case, states=["open"], **kind)
    assert alone.fills == {}
    assert [path.name for path in tmp_path.iterdir()] == ["desk_open_light_paths"]
    several = prepare(case, state="shaded", states=["open", "shaded"], **kind)
    assert [*several.fills] == ["south", "east"]
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["desk_light_paths", "desk_open_light_paths"]
    a, b = (one.at(NOON, state="open").picture.luminance.mean() for one in (alone, several))
    assert a == pytest.approx(b, rel=0.05)


def test_paths_count_with_the_shares_of_all_that_they_met():
    shares = np.array([0.2, 0.5, 0.3], np.float32)
    marks = np.array([0, 1, 3, (2 << BITS) | 1, (3 << 2 * BITS) | (3 << BITS) | 2], np.uint32)
    expected = np.append(shares, 1)[elements_of(marks)].prod(axis=1)
    product = share_of(mi.UInt32(marks), mi.Float(np.append(1, shares)))
    np.testing.assert_allclose(product.numpy(), expected, rtol=1e-6)


def test_rays_meet_no_glow_where_no_pane_of_a_fill_scatters():
    """One entry for all rays did not stand beside those of a fill whose panes scatter."""
    view = traced(ViewFacade.of(corner(), "open"), 3, samples=8)
    p, d = mi.Point3f([1.0, 2.0, 3.0], 0, 1), mi.Vector3f([0.0, 0.0, 0.0], 1, 0)
    at, weight = view.glows[0].seen(p, d, mi.Float([1.0, 1.0, 1.0]))
    assert at.numpy().tolist() == weight.numpy().tolist() == [0, 0, 0]


def test_glow_tables_know_the_same_patch_by_its_place():
    view = traced(ViewFacade.of(corner(), "open"), 3, samples=8)
    mixed = view.in_state((1, 0)).glow
    layout, openings = mixed.layout, view.glows[1].opening_of_entries(view.scenes.openings)
    looked, seen = layout.looked.numpy(), layout.seen.numpy()
    assert set(openings.tolist()) == {0, 1}
    # Only the patches of the south are those of the state, in their order.
    assert np.array_equal(looked == 1, openings == 0)
    assert np.array_equal(seen, looked)
    entry = layout.entry.numpy()[openings == 0]
    assert np.array_equal(entry, np.arange(len(mixed.table)))
    assert len(entry) == len(mixed.table) < len(mixed)
