"""Groups of panes from the command line: by façade, by schedule, and from files."""

import json
from itertools import cycle, islice

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import elements, evaluate, load_case, standards
from drcmitsuba.case.schedule import HOURS
from drcmitsuba.metrics import facade_states
from drcmitsuba.rendering.frames import states_at
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.pane_groups import PaneGroups
from tests.fast import slowly
from tests.system.small_room import CASE, SITE

EAST = """
[facade.east]
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
"""
DAYS = "months = [3]\nhours = [8, 17]\n"
TWO = CASE.replace("months = [3, 6]\n", DAYS) + EAST + SITE
GROUPS = """
[groups.south]
panes = ["glass"]
facing = "south"
schedule = "states.csv"
states = ["milk", "shade"]
[groups.east]
panes = ["glass"]
facing = "east"
schedule = "states.csv"
[materials.milk]
type = "diffuser"
transmittance = 0.5
reflectance = 0.3
"""


def evaluated(run, folder, text, *options):
    (folder / "case.toml").write_text(text)
    code, out, err = run("evaluate", folder / "case.toml", "-o", folder / "out", *options)
    assert code == 0, err
    return xr.load_dataset(folder / "out" / "illuminance.nc"), out


def states_of(folder, E):
    """States of the façade in every hour of an evaluated case."""
    groups = PaneGroups.of(load_case(folder / "case.toml")).states
    return [groups.label(states) for states in E["facade_state"].values.astype(int).tolist()]


def numbers(folder):
    return json.loads((folder / "out" / "metrics.json").read_text())


def test_each_façade_closes_on_its_own(run, tmp_path):
    E, out = evaluated(run, tmp_path, TWO)
    found = numbers(tmp_path)
    assert "south and east close and open each on its own" in out
    assert set(found["groups"]) == {"south", "east"}
    assert sum(found["groups"]["south"].values()) == pytest.approx(100)
    shut = [found["groups"][name]["shaded"] for name in ("south", "east")]
    assert found["shade_closed"]["value"] == pytest.approx(np.mean(shut))
    assert min(shut) > 0
    assert max(shut) < 100
    assert "group of panes" in out
    frames = E["time"].values + np.timedelta64(20, "m")
    assert states_of(tmp_path, E) == states_at(load_case(tmp_path / "case.toml"), frames)
    together, _ = evaluated(run, tmp_path, TWO.replace("[shading]", '[shading]\ngroups="together"'))
    assert "groups" not in numbers(tmp_path)
    # What the two have in common is the same; a façade that stays open lets more light in.
    np.testing.assert_array_equal(E["direct_sun"], together["direct_sun"])
    mine = (E["facade_state"].values > 0).sum(axis=1)
    both, one = mine == 2, mine == 1
    assert one.any()
    np.testing.assert_allclose(E["total"][both], together["total"][both], rtol=0.05)
    assert (E["total"][one].mean("sensor") > 1.2 * together["total"][one].mean("sensor")).all()


@pytest.mark.parametrize(
    "model", slowly(["three_phase", "daysim", "adaptive"], "daysim", "adaptive")
)
def test_any_model_of_the_sun_tells_façades_apart(run, tmp_path, model):
    exact, _ = evaluated(run, tmp_path, TWO)
    E, _ = evaluated(run, tmp_path, TWO + f'[sun]\nmodel = "{model}"\n')
    same = (E["facade_state"] == exact["facade_state"]).mean()
    assert same > {"three_phase": 0.6, "daysim": 0.8, "adaptive": 0.98}[model]
    assert (E["facade_state"] > 0).mean() > 0.2
    out, known = tmp_path / "out", tmp_path / "known.zarr"
    (out / "coefficients.zarr").rename(known)
    again, _ = evaluated(run, tmp_path, TWO + f'[sun]\nmodel = "{model}"\n',
                         "--coefficients", known)  # fmt: skip
    np.testing.assert_array_equal(again["facade_state"], E["facade_state"])


def test_files_give_the_same_year(run, tmp_path):
    E, _ = evaluated(run, tmp_path, TWO)
    out = tmp_path / "out"
    states = xr.open_zarr(out / "coefficients.zarr")["state"].values
    assert set(states) <= {"open", "shaded/open", "open/shaded", "shaded/shaded"}
    again = tmp_path / "again"
    code, _, err = run("illuminance", out / "coefficients.zarr", out / "sky.zarr", "-o", again)
    assert code == 0, err
    xr.testing.assert_allclose(xr.load_dataset(again / "illuminance.nc"), E)
    code, _, err = run("metrics", again / "illuminance.nc", "-o", again)
    assert code == 0, err
    found = json.loads((again / "metrics.json").read_text())
    assert found["sDA"]["value"] == numbers(tmp_path)["sDA"]["value"]
    assert found["groups"] == numbers(tmp_path)["groups"]
    code, _, err = run("export", out, "--matrices", tmp_path / "m")
    assert code == 0, err
    bins = (tmp_path / "m" / "bins.txt").read_text().splitlines()
    assert {"open", "shaded/open"} <= {line.split()[0] for line in bins}
    known = ("--coefficients", out / "coefficients.zarr")
    same, _ = evaluated(run, tmp_path, TWO, *known)
    np.testing.assert_allclose(same["total"], E["total"], rtol=1e-6)


def test_a_schedule_sets_the_state_of_every_hour(run, tmp_path):
    rows = islice(cycle(["open,open", "milk,shade", "shade,open", "2,1", "1,open"]), HOURS)
    (tmp_path / "states.csv").write_text("south,east\n" + "\n".join(rows))
    E, _ = evaluated(run, tmp_path, TWO + GROUPS)
    hour = (E["time"].dt.dayofyear.values - 1) * 24 + E["time"].dt.hour.values
    expected = np.array([[0, 0], [1, 1], [2, 0], [2, 1], [1, 0]])[hour % 5]
    np.testing.assert_array_equal(E["facade_state"], expected)
    assert states_of(tmp_path, E) == states_at(load_case(tmp_path / "case.toml"), E["time"].values)
    is_open = (expected == 0).all(axis=1)
    np.testing.assert_array_equal(E["total"][is_open], E["total_open"][is_open])
    share = E["total"].mean("sensor") / E["total_open"].mean("sensor")
    assert share[(expected == [2, 1]).all(axis=1)].max() < 0.4
    # The sum of the groups is the simulation of each state, within the errors.
    light = elements(load_case(tmp_path / "case.toml"))
    ours = light.in_states(expected)
    mean = E["total"].mean().item()
    scatter = np.hypot(ours["total_se"], E["total_se"]).mean().item()
    assert ours["total"].mean().item() == pytest.approx(mean, rel=0.02)
    assert scatter < 0.08 * mean
    names = np.array([["open", "milk", "shade"][i] for i in expected[:, 0]])
    named = np.stack([names, np.where(expected[:, 1], "shade", "open")], axis=1)
    south, east = (xr.DataArray(of, {"time": E["time"]}, ("time",)) for of in named.T)
    xr.testing.assert_allclose(light.illuminance({"south": south, "east": east}), ours)
    with pytest.raises(InputError, match="time stamps and openings"):
        light.in_states(expected[:, :1])


def test_many_states_are_recombined(run, tmp_path, monkeypatch):
    monkeypatch.setattr("drcmitsuba.metrics.facade_states.FEW", 1)
    rng = np.random.default_rng(5)
    states = np.stack([rng.integers(0, 3, HOURS), rng.integers(0, 2, HOURS)], axis=1)
    rows = "\n".join(f"{s},{e}" for s, e in states)
    (tmp_path / "states.csv").write_text("south,east\n" + rows)
    E, _ = evaluated(run, tmp_path, TWO + GROUPS)
    found = numbers(tmp_path)
    assert "groups of panes" in found["seconds"]
    assert found["sDA"]["low"] <= found["sDA"]["value"] <= found["sDA"]["high"]
    assert (xr.open_zarr(tmp_path / "out" / "coefficients.zarr")["state"] == "open").all()
    hour = (E["time"].dt.dayofyear.values - 1) * 24 + E["time"].dt.hour.values
    np.testing.assert_array_equal(E["facade_state"], states[hour])
    aimed = TWO.replace("[accuracy]", '[accuracy]\ntarget = "1 point"')
    more = '[sun]\nmodel = "adaptive"\n[colour]\nbands = 9\n'
    other, _ = evaluated(run, tmp_path, aimed + GROUPS + more)
    notes = "\n".join(numbers(tmp_path)["settings"]["notes"])
    assert "true suns light the hours whose light is summed" in notes
    assert '"1 point": light that façades share has no rounds' in notes
    assert "bands of colour are left out, since E of some hours is a sum" in notes
    plan = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert (plan["colour"]["on"], plan["colour"]["missing"]) == (False, True)
    closed = (E["facade_state"] > 0).any("group").values
    np.testing.assert_array_equal(other["facade_state"], E["facade_state"])
    np.testing.assert_allclose(other["total"][closed], E["total"][closed], rtol=1e-5)
    out = tmp_path / "out"
    code, _, err = run("illuminance", out / "coefficients.zarr", out / "sky.zarr")
    assert code == 2
    assert "a state is missing" in err


@pytest.mark.parametrize(
    ("kept", "verbs"),
    [
        ("metrics", ["plan"]),
        pytest.param("metrics", ["plan", "evaluate"], marks=pytest.mark.slow),
        pytest.param("all", ["plan", "evaluate"], marks=pytest.mark.slow),
    ],
)
def test_a_summed_year_has_what_glass_mirrors(run, tmp_path, monkeypatch, kept, verbs):
    """Six states, simulated one by one and in a sum: the plan leaves out nothing of either."""
    rows = islice(cycle(["open,open", "open,1", "milk,open", "milk,1", "2,open", "2,1"]), HOURS)
    (tmp_path / "states.csv").write_text("south,east\n" + "\n".join(rows))
    glass = TWO.replace("transmittance = 0.65", "transmittance = 0.65\nreflectance = 0.12")
    case = glass.replace(DAYS, DAYS + "days_per_week = 1\n") + GROUPS
    (tmp_path / "case.toml").write_text(case + f'[output]\nilluminance = "{kept}"\n')

    def entry_of(verb):
        code, out, err = run(verb, tmp_path / "case.toml", "-o", tmp_path / verb)
        assert code == 0, err
        written = json.loads((tmp_path / verb / "plan.json").read_text())
        return written["pane_to_pane"], " ".join(out.split())

    for few in (facade_states.FEW, 1):
        monkeypatch.setattr(facade_states, "FEW", few)
        for verb in verbs:
            entry, out = entry_of(verb)
            assert entry["on"]
            assert "glass that mirrors (east, south) faces another opening" in entry["reason"]
            assert "left out" not in out


def test_a_scene_shows_its_groups(run, tmp_path):
    (tmp_path / "states.csv").write_text("south,east\n" + "open,open\n" * HOURS)
    (tmp_path / "case.toml").write_text(TWO + GROUPS)
    code, _, err = run("case", tmp_path / "case.toml", "-o", tmp_path)
    assert code == 0, err
    assert (tmp_path / "scene.png").is_file()


def test_a_state_is_exported(run, refused, tmp_path):
    (tmp_path / "case.toml").write_text(TWO)
    scene = tmp_path / "rad"
    code, _, err = run("export", tmp_path / "case.toml", "--radiance", scene, "--state",
                       "open/shaded")  # fmt: skip
    assert code == 0, err
    assert "open/shaded" in (scene / "simulate.sh").read_text()
    more = ("--radiance", tmp_path / "no", "--state", "open/clsed")
    assert 'no state "clsed"' in refused("export", tmp_path / "case.toml", *more)


@pytest.mark.slow
def test_hours_beyond_the_period_count_where_c_holds_their_states(tmp_path, monkeypatch):
    """States at night are further ones; where they are too many, the period stays by itself."""
    by_day, by_night = ["open,open", "milk,shade"], ["shade,open", "2,1", "1,open", "open,shade"]
    hours = [hour % 24 for hour in range(HOURS)]
    rows = [by_day[h % 2] if 7 <= h < 19 else by_night[h % 4] for h in hours]
    (tmp_path / "states.csv").write_text("south,east\n" + "\n".join(rows))
    week = TWO.replace(DAYS, "")
    (tmp_path / "case.toml").write_text(week + GROUPS)
    case = load_case(tmp_path / "case.toml")
    with_year = evaluate(case)
    assert len(with_year.by_state.states) == 6
    judged = standards.verdicts(standards.Evidence.of_result(with_year))
    assert all(isinstance(verdict, standards.Verdict) for verdict in judged)
    monkeypatch.setattr(facade_states, "FEW", 1)  # five states one by one, as groups have states
    alone = evaluate(case)
    assert alone.daylight.year is None
    assert set(alone.by_state.states) == {"open", "milk/shade"}
    refused = standards.verdicts(standards.Evidence.of_result(alone))
    assert all(isinstance(verdict, standards.Refusal) for verdict in refused)
    for name in ("sDA", "ASE", "shade_closed"):
        assert alone.metrics[name]["value"] == with_year.metrics[name]["value"]
    np.testing.assert_array_equal(alone.illuminance["total"], with_year.illuminance["total"])
    assert evaluate(case, blocks=tmp_path / "cache").daylight.year is None  # for any weather
