"""Glare summed over openings and fills, against façades that are drawn and simulated as such."""

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import drcmitsuba
from drcmitsuba import InputError
from drcmitsuba.annual.applied_states import AppliedStates
from drcmitsuba.annual.run import Run
from drcmitsuba.case.schedule import hour_of_year
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.eye.openings import note_of
from drcmitsuba.glare_year import year
from drcmitsuba.glare_year.element_sampler import ElementSampler
from drcmitsuba.glare_year.eyes import eyes
from drcmitsuba.glare_year.rounds import StateSampler
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.metrics.intervals.rules import DRAWS
from drcmitsuba.plan import plan
from drcmitsuba.sky.daylight import daylight
from tests.unit.glare_year.glare_room import case_in
from tests.unit.glare_year.test_glare_of_films import FILM, klems
from tests.unit.model import box_room as box

TIMES = ("01-20T12:00", "03-21T09:00", "06-21T15:00")
FABRICS = """
[materials.cloth]
type = "diffuser"
transmittance = 0.1
reflectance = 0.4
[materials.thick]
type = "diffuser"
transmittance = 0.03
reflectance = 0.6
"""
EAST = """
[facade.east]
segments = 1
frame = 0.1
strips = [{ bottom = 0.9, top = 2.6, material = "glass" }]
"""
GROUPS = """
[groups.south]
panes = ["glass"]
facing = "south"
states = ["cloth", "thick"]
[groups.east]
panes = ["glass"]
facing = "east"
states = ["cloth", "thick"]
"""
FALSE_ALARMS = 1e-3


def finer(case, **accuracy):
    settings = {"replicates": 8, "paths": 32, **accuracy}
    return case.with_tables(accuracy=case.accuracy.model_copy(update=settings))


def simulated(case, *states):
    """Year of glare of states that are simulated one by one, each as a whole."""
    light = daylight(case)
    looking, run = eyes(case), Run.of(case, plan(case, light).scope)
    sampler = StateSampler(case, light, looking, Rule(), run, states)
    return year.rated(case, light, looking, states, sampler.first(), (), rule=Rule(), run=run)


def agree(ours, theirs, replicates=8):
    """Assert that E_v and DGP of the hours and views agree within both errors, and in sum.

    Errors of few replicates are Student's, of as many degrees of freedom as one of the two has.
    """
    for name in ("illuminance", "dgp"):
        a, b = (one[name].transpose("time", "view").values for one in (ours, theirs))
        errors = (one[f"{name}_se"].transpose("time", "view").values for one in (ours, theirs))
        error = np.hypot(*errors)
        z = np.abs(a - b) / np.maximum(error, 1e-3 * b)
        alarm = 1 - (1 - FALSE_ALARMS) ** (1 / z.size)
        assert z.max() < stats.t.isf(alarm / 2, replicates - 1), (name, a, b)
        # Hours share their paths: errors of a view add up, those of views do not.
        total = np.abs((a - b).sum(axis=0)) / (error.sum(axis=0) + 1e-3 * b.sum(axis=0))
        assert total.max() < stats.t.isf(FALSE_ALARMS / 2 / len(total), replicates - 1), name


@pytest.fixture(scope="module")
def office(tmp_path_factory):
    """Room with glass in two sides, a group of three states in each."""
    folder = tmp_path_factory.mktemp("office")
    case = finer(case_in(folder, more=EAST + FABRICS + GROUPS, times=TIMES))
    return case.with_tables(views={name: case.views[name] for name in ("window", "side")})


@pytest.fixture(scope="module")
def light(office):
    return drcmitsuba.glare_elements(office)


def test_any_combination_of_states_is_that_of_a_simulation(office, light):
    assert light.fills == dict.fromkeys(("south", "east"), ("glass", "cloth", "thick"))
    theirs = simulated(office, "open/cloth", "thick/open")
    for state, choice in (
        ("open/cloth", {"south": "glass", "east": "cloth"}),
        ("thick/open", {"south": "thick", "east": "glass"}),
    ):
        ours = light.evaluate(choice)
        assert ours.states == ("open",)
        agree(ours.hours.isel(state=0), theirs.hours.sel(state=state))
    assert not light.notes[-1].startswith("up to")  # no eye looks through two openings


@pytest.mark.slow
def test_no_choice_is_the_case_itself(office):
    view = {"window": office.views["window"]}
    case = finer(office.with_tables(views=view), replicates=2, paths=8)
    ours, theirs = drcmitsuba.glare_elements(case).evaluate(), drcmitsuba.glare(case)
    assert ours.states == theirs.states == ("open", "cloth/cloth", "thick/thick", "applied")
    xr.testing.assert_allclose(ours.hours, theirs.hours, rtol=1e-5)
    np.testing.assert_allclose(ours.replicates, theirs.replicates, atol=1e-5)


def test_fills_by_the_hour_are_those_of_each_hour(light):
    time = light.facades.light.sky["time"]
    names = xr.DataArray(["glass", "cloth", "thick"], {"time": time}, ("time",))
    ours = light.evaluate({"south": names, "east": "cloth"})
    assert ours.states == ("applied",)
    for hour, name in enumerate(names.values):
        alone = light.evaluate({"south": name, "east": "cloth"})
        for quantity in ("illuminance", "dgp"):
            a, b = (one.hours[quantity][0, hour] for one in (ours, alone))
            np.testing.assert_allclose(a, b, rtol=1e-5)


def plain_luminances(known, hours, shares):
    """Luminances of pixels (pixel, hour), part by part, with shares (hour, element + 1)."""
    seen, sky = known.seen, known.sky[hours].T
    L = np.zeros((len(seen.directions), len(hours)))
    for element, part in seen.sky.items():
        L += part.toarray() @ (sky * shares[:, element])
    points = np.zeros((len(seen.surfaces.points), len(known.sky)))
    points[known.surfaces.point, known.surfaces.time] = known.surfaces.luminance
    points = points[:, hours] * shares[:, seen.surfaces.element].T
    glow = seen.glow.sky @ sky
    lit = known.sun_index[hours] >= 0
    glow[:, lit] += seen.glow.suns[:, known.sun_index[hours][lit]] * known.sun[hours][lit]
    np.add.at(L, seen.films, glow * shares[:, seen.by_films].T)
    return L + seen.showing.toarray() @ points


def check_rows(place, shares):
    """Assert that rows sum up to what is seen in some hours, and by each element alone."""
    known, hours = place.in_facade(shares).known, np.array([2, 0])
    of_hours = known.shares[hours]
    np.testing.assert_allclose(
        known.at(hours), plain_luminances(known, hours, of_hours), rtol=1e-4, atol=1e-2
    )
    for element in known.elements(hours):
        only = np.zeros_like(of_hours)
        only[:, element] = 1
        np.testing.assert_allclose(
            known.rows(hours, element).luminance(), plain_luminances(known, hours, only),
            rtol=1e-4, atol=1e-2,
        )  # fmt: skip


def test_luminances_are_sums_over_what_is_seen(light):
    shares = np.array([[0.3, 0.7, 0, 1, 0, 0], [1, 0, 0, 0, 0, 1], [0, 0, 1, 1, 0, 0]], float)
    check_rows(light.places[0], shares)


def test_shares_weigh_light_and_sources(light):
    """E_v is linear in the shares but for paths back to the façade; sums of sources are."""
    hours = [
        light.evaluate({"south": south, "east": "thick"}).hours.isel(state=0)
        for south in ("glass", "cloth", {"glass": 0.3, "cloth": 0.7})
    ]
    glass, cloth, both = (each["illuminance"].values for each in hours)
    np.testing.assert_allclose(both, 0.3 * glass + 0.7 * cloth, rtol=0.03)
    sums = [(10 ** each["contrast"] - 1) * each["illuminance"] ** 1.87 for each in hours]
    glass, cloth, both = (each.values for each in sums)
    whole = np.maximum(0.3 * glass + 0.7 * cloth, 1e3)
    # Sources that join across two openings count as one in the façades of one fill.
    assert np.median(np.abs(both - whole) / whole) < 0.03


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"north": "glass"}, 'choice: opening: no opening "north"; choose from: "south", "east"'),
        ({"south": "clot"}, 'no fill "clot" of "south"; did you mean "cloth"?'),
        ({"south": {"glass": 0.5}}, "shares 0.5, 0, 0, 0.5 together; give shares"),
    ],
)
def test_bad_choices_are_refused(light, choice, message):
    with pytest.raises(InputError) as error:
        light.evaluate(choice)
    assert message in str(error.value)


def test_unknown_fills_are_refused(office):
    with pytest.raises(InputError, match='fills: no fill "clot"; did you mean "cloth"'):
        drcmitsuba.glare_elements(office, fills=["clot"])


@pytest.mark.slow
def test_a_film_beside_glass_glows_in_all_states(tmp_path):
    shade = '[shading]\nmaterial = "cloth"\n' + FABRICS
    film = FILM.format(file=klems(tmp_path, lifted=0.4)) + EAST.replace("glass", "film")
    case = finer(case_in(tmp_path, more=film + shade, times=TIMES))
    seen = drcmitsuba.glare_elements(case)
    ours, theirs = seen.evaluate(), simulated(case, "open", "shaded")
    assert len(seen.places[0].seen.films)
    check_rows(seen.places[0], np.repeat([[0.3, 0.7, 1.0]], len(TIMES), axis=0))
    assert ours.states == ("open", "shaded", "applied")
    for state in ("open", "shaded"):
        agree(ours.hours.sel(state=state), theirs.hours.sel(state=state))
        sharp = [one.hours["dgp_sharp"].sel(state=state) for one in (ours, theirs)]
        assert (sharp[0] >= ours.hours["dgp"].sel(state=state) - 1e-6).all()
        told = [one.hours["dgp_se"].sel(state=state) for one in (ours, theirs)]
        assert (abs(sharp[0] - sharp[1]) < 0.01 + 4 * np.hypot(*told)).all()


@pytest.mark.slow
def test_a_model_is_as_its_states(tmp_path):
    box.written(tmp_path, box.model(box.room()), "room.hbjson")
    office = case_in(tmp_path, more='[shading]\nmaterial = "cloth"\n' + FABRICS, times=TIMES)
    kept = [
        table for table in (tmp_path / "office.toml").read_text().split("\n[")
        if not table.startswith(("room", "facade"))
    ]  # fmt: skip
    text = "\n[".join(kept) + '[model]\nfiles = ["room.hbjson"]\n'
    (tmp_path / "model.toml").write_text(text)
    case = finer(drcmitsuba.load_case(tmp_path / "model.toml"))
    assert case.views == office.views
    ours = drcmitsuba.glare_elements(case).evaluate()
    theirs = simulated(case, "open", "shaded")
    for state in ("open", "shaded"):
        agree(ours.hours.sel(state=state), theirs.hours.sel(state=state))


def sampler_of(case):
    """Way in which `glare` simulates a case."""
    light = daylight(case)
    run = Run.of(case, plan(case, light).scope)
    return year._sampler(case, light, eyes(case), Rule(), run)


def test_groups_may_take_any_number_of_states(tmp_path):
    """Schedules of two groups of 14 states each, which take another pair in every hour."""
    names = [f"cloth{k}" for k in range(13)]
    cloths = "".join(
        f'[materials.{name}]\ntype = "diffuser"\ntransmittance = {0.02 * (k + 1):.2f}\n'
        for k, name in enumerate(names)
    )
    groups = "".join(
        f'[groups.{side}]\npanes = ["glass"]\nfacing = "{side}"\nstates = {names}\n'
        f'schedule = "{side}.csv"\n'
        for side in ("south", "east")
    ).replace("'", '"')
    hours = np.arange(8760)
    for side, step in (("south", 1), ("east", 5)):
        rows = ["open" if k == 0 else names[k - 1] for k in hours * step % 14]
        (tmp_path / f"{side}.csv").write_text(f"{side}\n" + "\n".join(rows) + "\n")
    case = case_in(tmp_path, more=EAST + cloths + groups, times=TIMES)
    sampler = sampler_of(case)
    assert isinstance(sampler, ElementSampler)
    assert sampler.states == ("open", *(f"{name}/{name}" for name in names), "applied")
    shares = sampler.facades.shares["applied"]
    taken = [np.flatnonzero(row) - [0, 14] for row in shares]
    assert [t.tolist() for t in taken] == [
        [h % 14, 5 * h % 14] for h in hour_of_year(sampler.tracing.light.sky["time"])
    ]


def test_other_states_of_draws_are_facades_in_hours_in_doubt_alone(office, monkeypatch):
    """By sums over elements, and state by state: hour 1 takes another state in some draws."""
    states, stamps = ("open", "cloth/cloth", "thick/cloth"), len(daylight(office).sky["time"])
    taken = np.resize([0, 1], stamps)
    drawn = np.resize([1, 2, 0], (1, DRAWS))
    closures = Closures(states, taken, taken / 2, np.array([1]), drawn, drawn / 2)
    rows = np.array([[0, 0], [1, 1]])[taken]
    applied = AppliedStates(FacadeStates(states, taken, rows), closures)
    for module in ("year", "facades"):
        monkeypatch.setattr(f"drcmitsuba.glare_year.{module}.applied_states", lambda *_: applied)
    by_element = sampler_of(office)
    assert isinstance(by_element, ElementSampler)
    every, starts = by_element.facades, by_element.tracing.openings.starts
    for others, row in zip(every.others, ([0, 0], [2, 1]), strict=True):
        differs = (others != every.shares["applied"]).any(axis=1)
        assert np.flatnonzero(differs).tolist() == [1]
        assert np.flatnonzero(others[1]).tolist() == [starts[0] + row[0], starts[1] + row[1]]
    by_state = sampler_of(office.with_tables(sun=Adaptive(model="adaptive")))
    places = [by_state.simulated.index(state) for state in ("open", "thick/cloth")]
    assert by_state.drawn.others[:, 1].tolist() == places
    assert np.argwhere(by_state.drawn.others != by_state.index).tolist() == [[0, 1], [1, 1]]
    for sampler in (by_element, by_state):
        assert np.unique(sampler.drawn.drawn[0]).tolist() == [0, 1, 2]
        assert (sampler.drawn.drawn[0] == 0).sum() == (drawn == 1).sum()


def test_an_adaptive_sun_is_simulated_state_by_state(office):
    case = office.with_tables(sun=Adaptive(model="adaptive"))
    sampler = sampler_of(case)
    assert isinstance(sampler, StateSampler)
    assert sampler.states[:3] == ("open", "cloth/cloth", "thick/thick")
    assert sampler.states[-1] == "applied"


def test_what_lies_beyond_two_openings_is_noted():
    assert note_of(0.0) == ()
    assert note_of(0.021)[0].startswith("up to 2.1 % of what an eye sees lies beyond two openings")
