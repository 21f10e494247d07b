"""Rows that differ in their façades share a simulation: the same numbers in any shares."""

import numpy as np
import pytest

import drcmitsuba
from drcmitsuba import load_case
from drcmitsuba.annual import study_facades
from drcmitsuba.annual.study import study
from drcmitsuba.annual.study_facades import FacadesJob, alike, jobs, together
from drcmitsuba.annual.variants import SharedElements, evaluate_variants, shared_facades
from drcmitsuba.case.study import load_study
from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.scene.shared_facades import SharedFacades
from drcmitsuba.sky.daylight import daylight
from tests import ROOT
from tests.system.small_room import changed

TEXT = changed(
    ("months = [3, 6]", "months = [3]"),
    ("replicates = 4", "replicates = 2"),
)
TOPS, TRANSMITTANCES, THRESHOLDS = [2.3, 2.5, 2.7], [0.5, 0.65], [300, 2000]
GRID = f"""
case = "case.toml"
[grid]
"facade.south.strips.0.top" = {TOPS}
"materials.glass.transmittance" = {TRANSMITTANCES}
"metrics.sda_threshold" = {THRESHOLDS}
"""


@pytest.fixture
def plan(tmp_path):
    (tmp_path / "case.toml").write_text(TEXT)
    (tmp_path / "study.toml").write_text(GRID)
    return load_study(tmp_path / "study.toml")


@pytest.fixture
def cases(plan):
    return [plan.case_of(row) for row in plan.each()]


def refused(*_, **__):
    raise AssertionError("a row is evaluated by itself")


def test_rows_are_those_of_variants_by_their_own_thresholds(plan, cases, tmp_path, monkeypatch):
    monkeypatch.setattr("drcmitsuba.annual.study.evaluate_within", refused)
    table = study(plan, tmp_path / "out").frame
    by_hand = []  # the same façades, with names of their own for the two kinds of glass
    for top in TOPS:
        for number, transmittance in enumerate(TRANSMITTANCES, 1):
            text = TEXT.replace("top = 2.7", f"top = {top}").replace("= 0.65", f"= {transmittance}")
            name = "glass" if number == 1 else "pane"
            text = text.replace('"glass"', f'"{name}"').replace(".glass]", f".{name}]")
            (tmp_path / "one.toml").write_text(text)
            by_hand.append(load_case(tmp_path / "one.toml"))
    expected = [result.metrics for result in evaluate_variants(by_hand)]
    for row, metrics in zip(range(0, 12, 2), expected, strict=True):
        assert table["sDA"][row] > table["sDA"][row + 1] or table["sDA"][row] == 0
        for name in ("ASE", "shade_closed"):
            assert table[name][row] == table[name][row + 1] == metrics[name]["value"]
    assert table["sDA"][0] > 0

    # A study that was stopped ends with the same numbers; what is done is only read.
    rows = sorted((tmp_path / "out" / "rows").iterdir())
    for file in rows[::2]:
        file.unlink()
    assert study(plan, tmp_path / "out").frame.equals(table)
    monkeypatch.setattr(study_facades.FacadesJob, "each", refused)
    assert study(plan, tmp_path / "out").frame.equals(table)


def test_a_stop_keeps_the_rows_that_are_done(plan, tmp_path, monkeypatch):
    whole, begun = SharedElements.evaluate, []

    def stopped(self, number):
        begun.append(number)
        if len(begun) == 4:
            raise KeyboardInterrupt
        return whole(self, number)

    monkeypatch.setattr(SharedElements, "evaluate", stopped)
    with pytest.raises(KeyboardInterrupt):
        study(plan, tmp_path / "out")
    assert len([*(tmp_path / "out" / "rows").iterdir()]) == 3


def test_an_unfit_film_is_told_in_its_row_alone(plan, tmp_path):
    good, bad = ROOT / "scenes" / "films" / "prism.xml", tmp_path / "bad.xml"
    bad.write_text("<WindowElement>")
    film = f'[materials.film]\ntype = "bsdf"\nfile = "{good}"\n[materials.shade]'
    (tmp_path / "case.toml").write_text(TEXT.replace("[materials.shade]", film))
    tops = [2.2, 2.3, 2.4, 2.5, 2.6, 2.7, 2.7]
    (tmp_path / "study.toml").write_text(f"""
case = "case.toml"
[columns]
"facade.south.strips.0.top" = {tops}
"facade.south.strips.0.material" = {["glass"] * 6 + ["film"]}
"materials.film.file" = {[str(good)] * 6 + [str(bad)]}
""")
    table = study(load_study(tmp_path / "study.toml"), tmp_path / "out").frame
    assert table["sDA"].notna().tolist() == [True] * 6 + [False]
    assert "bad.xml" in table["error"][6]


@pytest.mark.slow
def test_numbers_do_not_depend_on_how_many_workers_share_the_rows(cases):
    backend.select()
    job = FacadesJob(cases, [0, 3, 7])
    shares = job.split(2)
    assert [[*share.wanted] for share in shares] == [[0, 7], [3]]
    assert len(job.split(5)) == 3
    apart = {n: m for share in shares for n, m in share.make(lambda share: None).items()}
    at_once = job.make(lambda share: None)
    for number in job.wanted:
        for name in ("sDA", "ASE", "shade_closed", "msDA", "MSE"):
            assert apart[number][name] == at_once[number][name]


def test_a_pane_that_is_a_multiple_is_what_one_of_its_own_is(cases, monkeypatch):
    """Panes of three transmittances by one element and factors, and by an element each."""
    darker = [_with_glass(cases[0], transmittance) for transmittance in (0.65, 0.4, 0.3)]
    assert _fills(darker) == 2  # a pane and the shade
    assert _fills([case.with_tables(shading=None) for case in darker]) == 2  # never a single fill
    by_factors = [result.illuminance for result in evaluate_variants(darker)]
    monkeypatch.setattr(SharedFacades, "with_multiples", lambda self, shade: self)
    assert _fills(darker) == 4
    by_panes = [result.illuminance for result in evaluate_variants(darker)]
    for ours, theirs in zip(by_factors, by_panes, strict=True):
        assert ours["shade_closed"].equals(theirs["shade_closed"])
        for name in ("total", "total_open", "direct_sun"):
            most = float(theirs[name].max())
            np.testing.assert_allclose(ours[name], theirs[name], rtol=1e-4, atol=1e-6 * most)
    mean = [float(E["total_open"].mean()) for E in by_factors]
    assert mean[1] == pytest.approx(mean[0] * 0.4 / 0.65, rel=0.01)


@pytest.mark.parametrize(
    ("other", "factor"),
    [
        ({"transmittance": 0.5}, 0.5),
        ({"transmittance": 0.0}, 0.0),
        ({"transmittance": 0.5, "exponent": 3.0}, None),
        ({"transmittance": 0.5, "reflectance": 0.1}, None),
        ({"transmittance": 0.5, "ior": 1.5}, None),
    ],
)
def test_only_panes_alike_in_all_else_are_multiples(other, factor):
    pane = GlazingMaterial(type="glazing", transmittance=1.0)
    assert GlazingMaterial(type="glazing", **other).multiple_of(pane) == factor
    assert pane.multiple_of(None) is None
    dark = GlazingMaterial(type="glazing", transmittance=0.0)
    assert pane.multiple_of(dark) is None


def _fills(cases):
    """Number of fills of the window."""
    return max(len(fills) for fills in shared_facades(cases).panes.states.states)


def _with_glass(case, transmittance):
    """Case whose glass, of a name of its own, has another transmittance."""
    name = f"glass {transmittance}"
    glass = case.materials["glass"].model_copy(update={"transmittance": transmittance})
    strip = case.facade["south"].strips[0].model_copy(update={"material": name})
    facade = case.facade["south"].model_copy(update={"strips": (strip,)})
    materials = {name: glass, "shade": case.materials["shade"]}
    return case.with_tables(materials=materials, facade={"south": facade})


def test_a_name_stands_for_one_material(cases):
    made = alike(cases)
    names = [case.facade["south"].strips[0].material for case in made]
    assert set(names) == {"glass", "glass 2"}
    for case, one in zip(cases, made, strict=True):
        name = one.facade["south"].strips[0].material
        assert one.materials[name] == case.materials["glass"]
        assert one.shading == cases[0].shading
        assert one.metrics == cases[0].metrics


GROUP = '[groups.south]\npanes = ["gl*"]\nstates = ["shade", "opal"]\n'
OPAL = '[materials.opal]\ntype = "diffuser"\ntransmittance = 0.4\n'


def test_rows_with_groups_are_what_each_is_alone(tmp_path):
    (tmp_path / "case.toml").write_text(TEXT + OPAL + GROUP)
    (tmp_path / "study.toml").write_text(f"""
case = "case.toml"
[grid]
"facade.south.strips.0.top" = {TOPS}
"materials.opal.transmittance" = [0.3, 0.6]
""")
    plan = load_study(tmp_path / "study.toml")
    cases = [plan.case_of(row) for row in plan.each()]
    (whole,) = together((i, case, "sky") for i, case in enumerate(cases))
    assert len(whole) == 6
    made = alike(cases)
    assert [case.groups["south"].states[1] for case in made] == ["opal", "opal 2"] * 3
    metrics = FacadesJob(cases, [0, 5]).make(lambda share: None)
    for number, ours in metrics.items():
        theirs = drcmitsuba.evaluate(cases[number]).metrics
        for name in ("sDA", "ASE", "shade_closed"):
            assert ours[name]["low"] <= theirs[name]["high"]
            assert theirs[name]["low"] <= ours[name]["high"]
        assert ours["groups"].keys() == theirs["groups"].keys() == {"south"}
        assert ours["groups"]["south"]["opal"] == theirs["groups"]["south"]["opal"] > 0


def test_rows_share_a_simulation_where_one_holds_them(cases):
    def shared(others):
        return together((i, case, "sky") for i, case in enumerate(others))

    everything = [*range(len(cases))]
    assert shared(cases) == [everything]
    assert shared(cases[:10]) == []  # five façades
    weather = ("here" if i < 6 else "there" for i in everything)
    assert together(zip(everything, cases, weather, strict=True)) == []
    walls = cases[0].room.model_copy(update={"walls": 0.7})
    assert shared([*cases, *(c.with_tables(room=walls) for c in cases)]) == [
        everything, [i + 12 for i in everything],
    ]  # fmt: skip
    target = cases[0].accuracy.model_copy(update={"target": "1 point"})
    assert shared([case.with_tables(accuracy=target) for case in cases]) == []


def test_jobs_are_cut_to_fit_in_memory(cases, monkeypatch):
    suns = daylight(cases[0]).suns
    more = [*cases, *(_higher(case) for case in cases)]
    (whole,) = jobs(more, suns)
    assert (len(whole.cases), [*whole.wanted]) == (24, [*range(24)])
    sizes = []
    memory = study_facades.by_element.memory
    monkeypatch.setattr(
        study_facades.by_element,
        "memory",
        lambda *a, **k: sizes.append(memory(*a, **k)) or sizes[-1],
    )
    jobs(more, suns)
    monkeypatch.setattr(study_facades, "MEMORY", sizes[0])
    assert [len(job.cases) for job in jobs(more, suns)] == [12, 12]
    monkeypatch.setattr(study_facades, "MEMORY", 1)
    assert jobs(more, suns) == []


def _higher(case):
    facade = case.facade["south"]
    strips = (facade.strips[0].model_copy(update={"bottom": 1.2}),)
    return case.with_tables(facade={"south": facade.model_copy(update={"strips": strips})})


def test_rows_of_other_spaces_share_no_light(cases):
    """Metrics of one space are none of another's."""
    some = [case.with_spaces(["A"]) for case in cases]
    others = [case.with_spaces(["B"]) for case in cases]
    rows = [(number, case, "weather") for number, case in enumerate([*some, *others])]
    half = len(cases)
    assert together(rows) == [[*range(half)], [*range(half, 2 * half)]]
