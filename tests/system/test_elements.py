"""Any façade from one simulation: choices of fills against evaluations, and what is refused."""

import dataclasses
import pickle

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import InputError
from drcmitsuba.metrics.coefficients_by_state import LaterCoefficients
from drcmitsuba.scene.fills import openings_of
from drcmitsuba.transport.elements import mirrored_pairs
from tests import ROOT
from tests.system.small_room import CASE, DAYS, SHADING, SITE, STRIPS, changed

EAST = "[facade.east]\n" + STRIPS.replace("glass", "opal") + "\n"
OPAL = '[materials.opal]\ntype = "diffuser"\ntransmittance = 0.4\nreflectance = 0.3\n'
MARCH = "months = [3]"


def case_of(folder, *changes, more=""):
    text = changed((DAYS, MARCH), *changes) + more + SITE
    (folder / "case.toml").write_text(text)
    return drcmitsuba.load_case(folder / "case.toml")


@pytest.fixture(scope="module")
def clear(tmp_path_factory):
    """Two windows of glass, or holes, which send nothing back into the room."""
    east = "[facade.east]\n" + STRIPS + "\n"
    case = case_of(tmp_path_factory.mktemp("clear"), more=east)
    return drcmitsuba.elements(case, ["hole"])


@pytest.fixture(scope="module")
def light(tmp_path_factory):
    """A south window with a shade, and a translucent one to the east."""
    case = case_of(tmp_path_factory.mktemp("case"), more=EAST + OPAL)
    return drcmitsuba.elements(case, {"south": ["opal", "hole"], "opal (east)": ["glass", "wall"]})


def mean(result):
    return result.illuminance["total"].mean().item()


def agree(ours, theirs, name="total"):
    """Assert that means over hours and sensors agree within five standard errors of both."""
    a, b = ours.illuminance, theirs.illuminance
    error = np.hypot(a[f"{name}_se"].mean(), b[f"{name}_se"].mean()).item()
    assert abs((a[name] - b[name]).mean().item()) < 2 * error  # of one entry


def test_openings_and_their_fills_have_names(light):
    assert light.openings == ("south", "opal (east)")
    assert light.fills == {
        "south": ("glass", "shade", "opal", "hole"),
        "opal (east)": ("opal", "glass", "wall"),
    }
    assert "south" in repr(light)
    assert "<td>glass, shade, opal, hole</td>" in light._repr_html_()


def test_no_choice_is_the_case_itself(light):
    ours, theirs = light.evaluate(), drcmitsuba.evaluate(light.case)
    assert ours.illuminance.shade_closed.equals(theirs.illuminance.shade_closed)
    assert ours.metrics["shade_closed"] == theirs.metrics["shade_closed"]
    np.testing.assert_allclose(
        ours.illuminance["direct_sun"], theirs.illuminance["direct_sun"], rtol=1e-4, atol=1
    )
    for name in ("total", "total_open", "sky_open", "sun_open"):
        agree(ours, theirs, name)
    low, high = (theirs.metrics["sDA"][end] for end in ("low", "high"))
    assert low - 4 <= ours.metrics["sDA"]["value"] <= high + 4  # a sensor is 4 %
    kept = pickle.loads(pickle.dumps(ours))  # before C is made
    assert set(ours.coefficients.data_vars) == set(theirs.coefficients.data_vars)
    np.testing.assert_array_equal(kept.illuminance["sky_open"], ours.illuminance["sky_open"])


def test_fills_by_the_hour_are_what_stands_there_with_open_shades(clear):
    """They are no closed shades, and light with open shades is theirs: of a hole by the hour."""
    time = clear.daylight.sky["time"]
    south, east = clear.openings

    def by_hour(*fills):
        names = np.resize(np.array(fills, object), len(time))
        return xr.DataArray(names, {"time": time.values}, ["time"])

    constant, hourly = clear.evaluate({east: "hole"}), clear.evaluate({east: by_hour("hole")})
    for name in ("total", "total_open", "total_open_se", "sky_open", "sun_open"):
        np.testing.assert_allclose(
            hourly.illuminance[name], constant.illuminance[name], rtol=2e-5, atol=1e-3
        )
    assert hourly.metrics["shade_closed"] == constant.metrics["shade_closed"]
    np.testing.assert_array_equal(
        hourly.illuminance.shade_closed, constant.illuminance.shade_closed
    )
    mixed = clear.evaluate({south: "glass", east: by_hour("hole", "glass")}).illuminance
    holes, panes = (clear.evaluate({south: "glass", east: fill}).illuminance.total_open
                    for fill in ("hole", "glass"))  # fmt: skip
    np.testing.assert_allclose(mixed.total_open[::2], holes[::2], rtol=2e-5, atol=1e-3)
    np.testing.assert_allclose(mixed.total_open[1::2], panes[1::2], rtol=2e-5, atol=1e-3)
    assert not mixed.shade_closed.any()


def test_a_shade_by_the_hour_is_closed_in_its_hours(clear):
    time = clear.daylight.sky["time"]
    names = np.resize(np.array(["glass", "shade", "shade", "shade"], object), len(time))
    east = xr.DataArray(names, {"time": time.values}, ["time"])
    result = clear.evaluate({clear.openings[0]: "glass", clear.openings[1]: east})
    np.testing.assert_array_equal(result.illuminance.shade_closed, names == "shade")
    shut = result.metrics["shade_closed"]["value"]
    assert shut == pytest.approx(100 * (names == "shade").mean())


def test_a_choice_is_the_case_drawn_so(light, tmp_path):
    ours = light.evaluate({"opal (east)": "glass", "south": "opal"})
    south, east = (STRIPS, STRIPS.replace("glass", "opal")), "[facade.east]\n" + STRIPS + "\n"
    drawn = case_of(tmp_path, south, (SHADING, ""), more=east + OPAL)
    theirs = drcmitsuba.evaluate(drawn)
    assert not ours.illuminance["shade_closed"].any()  # south has no clear pane
    agree(ours, theirs)
    agree(ours, theirs, "direct_sun")


def test_shares_are_means_of_fills_in_a_room_that_reflects_little(light):
    """The paths back to the façade, a few per cent, are products of shares."""
    alone = [mean(light.evaluate({"south": fill})) for fill in ("glass", "opal")]
    both = mean(light.evaluate({"south": {"glass": 0.25, "opal": 0.75}}))
    assert both == pytest.approx(0.25 * alone[0] + 0.75 * alone[1], rel=0.01)


def test_fills_by_the_hour_are_those_of_each_hour(light):
    time = light.daylight.sky["time"]
    early = time.dt.hour.values < 12
    names = xr.DataArray(np.where(early, "hole", "opal"), {"time": time}, ("time",))
    shares = xr.DataArray(
        np.stack([early, ~early], axis=1).astype(float), {"time": time, "fill": ["hole", "opal"]},
        ("time", "fill"),
    )  # fmt: skip
    E = light.illuminance({"south": names})
    xr.testing.assert_allclose(light.illuminance({"south": shares}), E)
    backwards = light.illuminance({"south": names[::-1]})  # order of its hours matters not
    xr.testing.assert_identical(backwards, E)
    for fill, hours in (("hole", early), ("opal", ~early)):
        of_fill = light.illuminance({"south": fill}).isel(time=hours)
        xr.testing.assert_allclose(of_fill, E.isel(time=hours), rtol=1e-4)
    result = light.evaluate({"south": names})
    share = {name: value for name, value in result.metrics["groups"]["south"].items() if value}
    assert share == {"hole": 100 * early.mean(), "opal": 100 * (~early).mean()}
    np.testing.assert_allclose(result.illuminance["total"], E["total"], rtol=1e-3)


@pytest.mark.parametrize("fill", ["glass", "opal", "hole", {"glass": 0.3, "hole": 0.7}])
def test_a_fill_for_every_hour_is_that_fill(light, fill, tmp_path):
    time, shares = light.daylight.sky["time"], fill if isinstance(fill, dict) else {fill: 1.0}
    table = np.tile([*shares.values()], (len(time), 1))
    hourly = xr.DataArray(table, {"time": time, "fill": [*shares]}, ("time", "fill"))
    ours, theirs = light.evaluate({"south": hourly}), light.evaluate({"south": fill})
    for name in ("total", "direct_sun", "direct_sun_se"):
        np.testing.assert_allclose(
            ours.illuminance[name], theirs.illuminance[name], rtol=1e-3, atol=1e-2, err_msg=name
        )
    for name in ("sDA", "ASE", "MSE"):
        assert ours.metrics[name] == theirs.metrics[name], name
    ours.save(tmp_path)


@pytest.mark.parametrize("model", ["three_phase", "daysim"])
def test_a_fill_for_every_hour_is_that_fill_by_shared_suns(tmp_path, model):
    case = case_of(tmp_path, more=f'[sun]\nmodel = "{model}"\n' + OPAL)
    light = drcmitsuba.elements(case, ["opal"])
    (opening,), time = light.openings, light.daylight.sky["time"]
    hourly = xr.DataArray(np.full(len(time), "opal"), {"time": time}, ("time",))
    result = light.evaluate({opening: hourly})
    assert float(result.illuminance["direct_sun"].max()) == 0
    assert "straight" in result.coefficients  # which are made when they are asked for
    assert any("stands for several hours" in note for note in result.metrics["settings"]["notes"])


def test_groups_of_a_choice_and_of_the_shade_have_their_own_names(tmp_path):
    """The shade of the south covers what stands in place of the opal, too."""
    opal = STRIPS.replace("glass", "opal").partition("[")[2].rpartition("]")[0]
    lower = opal.replace("2.7", "0.8").replace("0.9", "0.2")
    strips = STRIPS.rpartition("]")[0] + ", " + lower + "]"
    case = case_of(tmp_path, (STRIPS, strips), more="[facade.east]\n" + STRIPS + "\n" + OPAL)
    light = drcmitsuba.elements(case, ["shade", "hole", "wall"])
    time = light.daylight.sky["time"]
    hourly = xr.DataArray(np.where(time.dt.hour < 12, "hole", "wall"), {"time": time}, ("time",))
    result = light.evaluate({"south": hourly}, drawn={"opal (south)": "hole"})
    assert set(result.metrics["groups"]) == {"south", "east", "south (by the hour)"}


def test_differences_of_façades_share_their_paths(light):
    """Two façades of the same elements differ by far less than their errors."""
    glass, opal = (light.evaluate({"opal (east)": fill}) for fill in ("opal", {"opal": 1.0}))
    xr.testing.assert_identical(glass.illuminance["total"], opal.illuminance["total"])


@pytest.mark.parametrize("choice", [{}, {"south": "opal"}, {"south": {"glass": 0.4, "opal": 0.6}}])
def test_known_years_give_what_coefficients_give(light, choice):
    """E of the hours by element, summed by a choice, against C of the choice times L."""
    ours = light.evaluate(choice)
    without = dataclasses.replace(light)
    vars(without)["_light"] = None  # as where memory does not hold them
    theirs = without.evaluate(choice)
    assert list(ours.illuminance.data_vars) == list(theirs.illuminance.data_vars)
    same_light(ours.illuminance, theirs.illuminance)
    for name in ("direct_sun", "direct_sun_se", "sky_open", "sun_open"):
        xr.testing.assert_identical(ours.illuminance[name], theirs.illuminance[name])
    for name in ("shade_closed", "undecided", "groups", "sDA", "ASE", "msDA", "MSE"):
        assert ours.metrics.get(name) == theirs.metrics.get(name), name
    assert isinstance(ours.by_state, LaterCoefficients)
    xr.testing.assert_identical(ours.coefficients, theirs.coefficients)


def mixtures(light, opening):
    """A share of the hole for every hour, one of 21."""
    time, first = light.daylight.sky["time"], light.fills[opening][0]
    share = np.random.default_rng(len(opening)).integers(0, 21, len(time)) / 20
    return xr.DataArray(
        np.stack([share, 1 - share], axis=1), {"time": time, "fill": ["hole", first]},
        ("time", "fill"),
    )  # fmt: skip


@pytest.mark.parametrize("hourly", [0, 1, 2])
def test_plain_sums_of_known_years_give_what_coefficients_give(clear, hourly):
    """Windows that send nothing back: with their shades, and with shares of one or two by the hour.

    Two make more states of the façade than are told apart.
    """
    assert clear._light.summed is not None
    choice = {opening: mixtures(clear, opening) for opening in clear.openings[:hourly]}
    ours = clear.evaluate(choice)
    without = dataclasses.replace(clear)
    vars(without)["_light"] = None
    theirs = without.evaluate(choice)
    same_light(ours.illuminance, theirs.illuminance)
    for name in ("shade_closed", "undecided", "groups", "sDA", "ASE", "msDA", "MSE"):
        assert ours.metrics.get(name) == theirs.metrics.get(name), name


def same_light(ours, theirs):
    """Assert that illuminances are the same but for the order of their sums."""
    for name, values in theirs.data_vars.items():
        atol = 1e-4 * theirs[name.replace("_se", "")].max().item()  # of a small difference
        np.testing.assert_allclose(ours[name], values, rtol=1e-3, atol=atol, err_msg=name)
    for name in theirs.coords:
        xr.testing.assert_identical(ours[name].variable, theirs[name].variable)
    assert ours.attrs == theirs.attrs


NOON = np.datetime64("2015-03-01T08", "ns")


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"north": "glass"}, 'choice: opening: no opening "north"; choose from: '),
        ({"south": "gass"}, 'no fill "gass" of "south"; did you mean "glass"?'),
        ({"south": {"glass": 0.5, "opal": 0.4}}, "shares 0.5, 0, 0.4, 0, 0.9 together; give"),
        ({"south": {"glass": 1.5, "opal": -0.5}}, "give shares from 0 that add up to 1"),
        ({"south": 3.0}, "choice: south: float; give a fill"),
        ({"south": {"glass": "1"}}, 'the share "1" of "glass"; give a number from 0 to 1'),
        ({"south": xr.DataArray([True], {"time": [NOON]}, ("time",))}, "no fill at 2015-03-"),
        ({"south": xr.DataArray(["glass"], {"time": ["noon"]}, ("time",))}, "as datetime64"),
        (
            {"south": xr.DataArray([[0.5, 0.5]], {"time": [NOON]}, ("time", "fill"))},
            "2 shares without names",
        ),
        (
            {"south": xr.DataArray([["a"]], {"time": [NOON]}, ("time", "fill"))},
            "shares of type <U1; give numbers",
        ),
        ("opal", 'choice: opening: "opal"; give a mapping from openings to fills'),
        ({"south": xr.DataArray(["glass"], dims="hour")}, "an array with dims hour; give the dim"),
        ({"south": xr.DataArray(["glass"], dims="time")}, "1 entries without time stamps, the "),
        (
            {
                "south": xr.DataArray(
                    ["glass"], {"time": [np.datetime64("2015-03-01T08", "ns")]}, dims="time"
                )
            },
            "no fill at 2015-03-",
        ),
    ],
)
def test_bad_choices_are_refused(light, choice, message):
    with pytest.raises(InputError) as error:
        light.evaluate(choice)
    assert message in str(error.value)


def test_states_follow_their_labels_and_an_opening_is_chosen_once(light):
    hours = light.daylight.alone().sky["time"].values
    states = np.random.default_rng(1).integers(0, np.array(light.groups.last) + 1,
                                               (len(hours), len(light.openings)))  # fmt: skip
    named = xr.DataArray(
        states, {"time": hours, "opening": [*light.openings]}, ("time", "opening")
    )[::-1, ::-1]
    xr.testing.assert_identical(light.in_states(named), light.in_states(states))
    with pytest.raises(InputError, match="south is in the choice, too; name it in one of them"):
        light.evaluate({"south": "glass"}, drawn={"south": "opal"})
    with pytest.raises(InputError, match=r'fills: "hole"; give a list: \["hole"\]'):
        drcmitsuba.elements(light.case, "hole")


@pytest.mark.parametrize(
    ("fills", "message"),
    [
        ({"west": ["glass"]}, 'fills: no opening "west"; choose from: "south"'),
        (["gass"], 'fills: no fill "gass"; did you mean "glass"?'),
    ],
)
def test_bad_fills_are_refused(tmp_path, fills, message):
    with pytest.raises(InputError) as error:
        drcmitsuba.elements(case_of(tmp_path), fills)
    assert message in str(error.value)


def test_true_suns_take_the_place_of_an_adaptive_one_and_targets_add_no_rounds(tmp_path):
    plain = drcmitsuba.elements(case_of(tmp_path)).evaluate({})
    adaptive = drcmitsuba.elements(case_of(tmp_path, more='[sun]\nmodel = "adaptive"\n'))
    np.testing.assert_array_equal(
        adaptive.evaluate({}).illuminance["total"], plain.illuminance["total"]
    )
    aimed = drcmitsuba.elements(
        case_of(tmp_path, ("[accuracy]\n", '[accuracy]\ntarget = "1 point"\n'))
    )
    result = aimed.evaluate({})
    np.testing.assert_array_equal(result.illuminance["total"], plain.illuminance["total"])
    note = 'accuracy.target: "1 point": light that façades share has no rounds toward it'
    assert note in result.metrics["settings"]["notes"]
    assert note not in plain.metrics["settings"]["notes"]


def test_two_groups_of_one_pane_are_refused(tmp_path):
    groups = '[groups.a]\npanes = ["glass"]\n[groups.b]\npanes = ["gla*"]\n'
    with pytest.raises(InputError, match="belongs to a, too; name it once"):
        drcmitsuba.elements(case_of(tmp_path, more=groups))


def test_rooms_without_panes_are_refused(tmp_path):
    shut = CASE.replace(STRIPS, STRIPS.replace("glass", "wall"))
    (tmp_path / "shut.toml").write_text(shut)
    with pytest.raises(InputError, match="no pane to the outside"):
        drcmitsuba.elements(tmp_path / "shut.toml")


def test_a_shade_that_covers_nothing_is_no_opening(tmp_path):
    case = case_of(tmp_path, (STRIPS, STRIPS.replace("glass", "opal")), more=OPAL)
    assert case.shading is not None
    assert openings_of(case).states.names == ("opal (south)",)


@pytest.mark.parametrize("of_film", [False, True])
def test_the_plan_says_what_a_sum_leaves_out(tmp_path, of_film):
    """Glass in two sides mirrors light from pane to pane; a film would throw it on by its lobes."""
    east, film = STRIPS, ""
    if of_film:
        file = (ROOT / "scenes" / "films" / "prism.xml").as_posix()
        east, film = STRIPS.replace("glass", "film"), f'type = "bsdf"\nfile = "{file}"\n'
    case = case_of(
        tmp_path, ("transmittance = 0.65", "transmittance = 0.65\nreflectance = 0.12"),
        more=f"[facade.east]\n{east}\n" + (f"[materials.film]\n{film}" if of_film else ""),
    )  # fmt: skip
    light = drcmitsuba.elements(case)
    assert light.planned.scope.pane_to_pane
    entry = light.evaluate().plan["pane_to_pane"]
    assert entry["on"] is not of_film
    assert ("left out, since E is a sum over openings" in entry["reason"]) is of_film
    assert "in other hours" not in entry["reason"]


def test_pairs_of_openings_that_are_left_out_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(mirrored_pairs, "MOST_PAIRS", 0)
    mirroring = ("transmittance = 0.65", "transmittance = 0.65\nreflectance = 0.12")
    light = drcmitsuba.elements(case_of(tmp_path, mirroring, more=f"[facade.east]\n{STRIPS}\n"))
    count = light.channels[0].pairs.left_out
    assert count >= 2
    result = light.evaluate()
    assert result.plan["pane_to_pane"]["pairs_left_out"] == count
    told = [note for note in result.metrics["settings"]["notes"] if f"{count} pairs" in note]
    assert len(told) == 1


def test_fills_may_mirror_where_what_is_drawn_does_not(tmp_path):
    shiny = '[materials.shiny]\ntype = "glazing"\ntransmittance = 0.65\nreflectance = 0.3\n'
    case = case_of(tmp_path, more=f"[facade.east]\n{STRIPS}\n{shiny}")
    assert len(drcmitsuba.elements(case, ["shiny"]).channels[0].pairs)
    assert not len(drcmitsuba.elements(case, ["hole"]).channels[0].pairs)
    off = case_of(
        tmp_path, more=f"[facade.east]\n{STRIPS}\n{shiny}[effects]\npane_to_pane = 'off'\n"
    )
    assert not len(drcmitsuba.elements(off, ["shiny"]).channels[0].pairs)


def test_what_is_drawn_is_no_further_fill(tmp_path):
    case = case_of(tmp_path, more=EAST + OPAL)
    openings = openings_of(case, ["glass", "opal"]).states
    assert openings.states == (("open", "shade", "opal"), ("open", "glass"))


@pytest.mark.parametrize("hourly", [False, True])
def test_sun_by_a_bare_window_closes_no_shade_of_another_façade(clear, hourly):
    """The sun in the bare eastern window closes no shade of the south in the morning."""
    time = clear.daylight.sky["time"]
    bare = xr.DataArray(np.full(len(time), "glass"), {"time": time.values}, ["time"])
    south, east = clear.openings
    both = clear.evaluate().metrics["groups"]
    alone = clear.evaluate({east: bare if hourly else "glass"}).metrics["groups"]
    assert alone[south] == both[south]
    assert both[south]["shaded"] != both[east]["shaded"]
