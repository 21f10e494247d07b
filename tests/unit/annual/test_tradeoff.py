"""The trade-off: its design, its errors on numbers whose answer is known, its table and picture."""

import os
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from drcmitsuba_plugins.tensor import TensorTree

from drcmitsuba.annual.tradeoff import Row, Tradeoff, finer_samples, tradeoff
from drcmitsuba.annual.tradeoff.errors import (
    Errors,
    Estimate,
    SettingResult,
    Yardstick,
    jackknife,
    mean_square,
)
from drcmitsuba.annual.tradeoff.reference import Reference, some_hours, some_sensors
from drcmitsuba.annual.tradeoff.run import announcement
from drcmitsuba.annual.tradeoff.settings import (
    LONGEST,
    RAYS,
    coarser,
    default,
    design,
    spaced,
    times_samples,
    trees,
)
from drcmitsuba.annual.tradeoff.table import frontier, pareto
from drcmitsuba.bsdf.merge import merge
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend, process
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.materials import film
from drcmitsuba.transport.photons.ports import of_sky
from drcmitsuba.transport.photons.tracer import of_patch


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def room(**tables):
    sensors = {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 0.5}
    return Case.model_validate({"room": {"size": [4, 5, 3]}, "sensors": sensors, **tables})


# ---- design -----------------------------------------------------------------------------------


def test_one_setting_changes_at_a_time(tmp_path):
    case = room()
    settings = design(case, tmp_path, solved_cells=True)
    base = settings[0].case
    assert settings[0].name == "default, yours"
    table = {
        "samples": "accuracy", "cell size": "accuracy", "sky": "sky", "sensor spacing": "sensors",
        "interreflection": "effects",
    }  # fmt: skip
    for setting in settings[1:]:
        changed = {k for k in Case.model_fields if getattr(setting.case, k) != getattr(base, k)}
        if setting.varied in table:
            assert changed == {table[setting.varied]}
        elif setting.varied == "sun model":
            assert "sun" in changed <= {"sun", "sky"}
        else:
            assert setting.varied == "combination"
            assert changed
    assert len({s.name for s in settings}) == len(settings)
    assert {*table, "sun model"} <= {s.varied for s in settings}


def test_the_own_setting_is_listed_where_it_differs(tmp_path):
    case = room(accuracy={"paths": 64, "seed": 7, "target": "1 point"}, sky={"subdivision": 2})
    first, second = design(case, tmp_path, solved_cells=True)[:2]
    assert (first.varied, second.varied) == ("default", "yours")
    assert first.case.accuracy == Accuracy(seed=7)
    assert first.case.sky.subdivision == 1
    limited = second.case.accuracy
    assert limited == case.accuracy.model_copy(update={"time_limit": LONGEST})
    assert second.case.model_copy(update={"accuracy": case.accuracy}) == case


def test_samples_are_multiplied_within_bounds():
    few, many = times_samples(Accuracy(), 1 / 8), times_samples(Accuracy(), 1e9)
    assert few.paths == 16
    assert few.sensor_sun_samples == 1
    assert many.sensor_sun_samples == 1 << 10
    changed = {k for k in Accuracy.model_fields if getattr(few, k) != getattr(Accuracy(), k)}
    assert changed == set(RAYS)


@pytest.mark.parametrize("factor", [2, 3])
def test_sensors_further_apart_keep_the_middle_of_their_grid(factor):
    case = room()
    old, new = case.sensors, spaced(case, factor).sensors
    assert new.count == tuple(-(-n // factor) for n in old.count)
    for axis in (0, 1):
        middle = old.corner[axis] + old.count[axis] * old.spacing / 2
        assert new.corner[axis] + new.count[axis] * new.spacing / 2 == pytest.approx(middle)


def test_variants_keep_the_folder_of_the_case(tmp_path):
    case = load_case("classroom/reference/o3")
    for setting in design(case, tmp_path, solved_cells=True):
        assert setting.case.path(Path("x")) == case.path(Path("x"))
        assert setting.case.source == case.source
    assert default(case).materials == case.materials


def test_films_lose_levels(tmp_path):
    case = load_case("classroom/reference/o3")
    (fine,) = trees(case).values()
    settings = {s.name: s.case for s in design(case, tmp_path, solved_cells=True)}
    normal = np.array([[0.0, 0.0, -1.0], [0.3, -0.5, -0.81]])
    for name, levels in (("film −1 level", 1), ("film −2 levels", 2)):
        file = film(settings[name].materials["film"].file).file
        tree = file.components["tb"]
        assert tree.depth == fine.components["tb"].depth - levels
        # A coarser tree has the mean of its cells, to the four digits that files have.
        T, T_fine = (f.components["tb"].albedos().mean() for f in (file, fine))
        assert pytest.approx(T_fine, rel=1e-3) == T
        assert file.hemispherical(normal)[0] == pytest.approx(
            fine.hemispherical(normal)[0], rel=0.2
        )


@pytest.mark.parametrize("rank", [3, 4])
def test_a_coarser_tree_has_the_mean_of_its_cells(rank):
    rng = np.random.default_rng(rank)
    grid = rng.random((8,) * rank) ** 3
    tree = merge(TensorTree.of_grid(grid), percent=60)
    assert len(set(tree.level)) > 1
    small = coarser(tree, 1)
    assert small.depth == 2
    # Every cell of the coarser tree, against the mean of the finer one's values in it.
    fine = np.zeros(8**rank)
    size = 2 ** (rank * (3 - tree.level))
    for start, n, value in zip(tree.start, size, tree.value, strict=True):
        fine[start : start + n] = value
    shown = np.zeros(4**rank)
    for start, n, value in zip(
        small.start, 2 ** (rank * (2 - small.level)), small.value, strict=True
    ):
        shown[start : start + n] = value
    assert shown == pytest.approx(fine.reshape(4**rank, -1).mean(axis=1))


def test_a_tree_keeps_its_root():
    tree = TensorTree.of_grid(np.arange(16.0).reshape((2,) * 4))
    root = coarser(tree, 5)
    assert (root.depth, len(root), root.value[0]) == (0, 1, 7.5)


# ---- hours and sensors of the reference ---------------------------------------------------------


def test_hours_are_spread_over_day_and_year():
    day = np.arange("2015-01-01", "2016-01-01", dtype="datetime64[D]")
    times = np.ravel(day[:, None] + np.arange(8, 18).astype("timedelta64[h]"))
    some = times[some_hours(times)]
    assert 190 <= len(some) <= 210
    hour = (some - some.astype("datetime64[D]")).astype("timedelta64[h]").astype(int)
    assert np.bincount(hour, minlength=18)[8:].min() >= 18
    assert len(np.unique(some.astype("datetime64[M]"))) == 12
    assert len(some_hours(times[:150])) == 150


def test_sensors_are_thinned_in_both_directions():
    case = room()
    assert some_sensors(case).tolist() == list(range(12))
    thin = some_sensors(case, most=4)
    assert thin.tolist() == [0, 2, 6, 8]


# ---- errors -------------------------------------------------------------------------------------

TIMES, SENSORS, ROUNDS = 60, 40, 12
NOISE, ERROR = 200.0, 60.0


@pytest.fixture(scope="module")
def truth():
    return 400 + 900 * np.random.default_rng(1).random((TIMES, SENSORS))


def reference(truth, noise=NOISE, seed=2):
    rng = np.random.default_rng(seed)
    rounds = truth + noise * rng.standard_normal((ROUNDS, *truth.shape))
    state, E = np.zeros(TIMES, int), rounds.astype(np.float32)
    times = np.arange(TIMES).astype("datetime64[h]")
    return Reference(times, np.arange(SENSORS), E, E, np.zeros_like(truth), state, "known", 1.0)


def evaluated(total, direct=None):
    direct = np.zeros_like(total) if direct is None else direct
    return SettingResult(total, total, direct, np.zeros(TIMES, int), 1.0, 1)


def yardstick(reference, **thresholds):
    return Yardstick(reference, Metrics(**thresholds), share=0.1, step_hours=1.0)


def test_noise_of_the_reference_is_taken_off(truth):
    """The noise is three times the error, and its mean's is as large as the error."""
    result = evaluated(truth + ERROR * np.random.default_rng(3).standard_normal(truth.shape))
    errors = yardstick(reference(truth)).errors(result, same_sensors=True)
    expected = 100 * ERROR / truth.mean()
    plain = 100 * np.sqrt(ERROR**2 + NOISE**2 / ROUNDS) / truth.mean()
    assert plain > 1.3 * expected
    assert not errors.is_hidden
    assert errors.rms_error < 0.04 * expected
    assert abs(errors.rms - expected) < 3 * errors.rms_error
    assert abs(errors.mean.value) < 3 * errors.mean.error + 100 * ERROR / truth.mean() / 49


def test_an_offset_is_the_error_of_the_mean(truth):
    errors = yardstick(reference(truth)).errors(evaluated(truth + 30), same_sensors=True)
    assert errors.mean.value == pytest.approx(100 * 30 / truth.mean(), abs=3 * errors.mean.error)
    assert 0 < errors.mean.error < 1


def test_the_truth_has_a_hidden_error_and_an_upper_bound(truth):
    """The estimate is as often too low as too high, over many references of the truth."""
    squares = []
    for seed in range(20):
        errors = yardstick(reference(truth, seed=seed)).errors(evaluated(truth), same_sensors=True)
        squares.append(errors.square.value / errors.square.error)
        assert errors.rms_below > 0
    assert abs(np.mean(squares)) < 3 * np.std(squares) / np.sqrt(20)
    assert 0.6 < np.std(squares) < 1.6


def test_own_error_of_the_reference(truth):
    own = yardstick(reference(truth)).own_rms
    assert own == pytest.approx(100 * NOISE / np.sqrt(ROUNDS) / truth.mean(), rel=0.02)


def test_e_is_compared_in_the_same_state_of_the_façade(truth):
    """Hour 0 is closed in both, 1 in the reference only, 2 in the setting only; 3 in two ways.

    Rounds of the reference do not agree on hour 4, which counts in no share of states.
    """
    state, mine = np.zeros((2, TIMES), int)
    state[:2], state[3], state[4], mine[[0, 2]], mine[3], mine[4] = 1, 1, -1, 1, 2, 1
    applied = np.where((state > 0)[:, None], 0.1 * truth, truth)
    applied = np.broadcast_to(applied, (ROUNDS, TIMES, SENSORS)).astype(np.float32)
    ref = replace(reference(truth, noise=0.0), applied=applied, state=state)
    total = np.where(mine[:, None] > 0, 0.1 * truth, truth)
    result = SettingResult(total, truth, np.zeros_like(truth), mine, 1.0, 1)
    errors = yardstick(ref).errors(result, same_sensors=True)
    assert errors.rms < 1e-3
    assert errors.shade.value == pytest.approx(100 * 3 / (TIMES - 1))


def test_direct_sun_is_wrong_where_it_is_on_the_other_side(truth):
    sun = np.full_like(truth, 1000.0)
    sun[0] = 999.0
    ref = replace(reference(truth), direct_sun=sun)
    errors = yardstick(ref).errors(evaluated(truth, np.full_like(truth, 1500.0)), same_sensors=True)
    assert errors.direct_sun.value == pytest.approx(100 / TIMES)


def test_ase_takes_its_hours_from_the_share_of_the_year(truth):
    """250 h of a year are 25 of a tenth of it."""
    sun = np.zeros_like(truth)
    sun[:25, 0], sun[:24, 1] = 1000.0, 1000.0
    measure = yardstick(replace(reference(truth), direct_sun=sun))
    assert measure.ase == pytest.approx(100 / SENSORS)
    errors = measure.errors(evaluated(truth), same_sensors=True)
    assert errors.ase.value == pytest.approx(-100 / SENSORS)


def test_another_grid_has_sda_and_ase_only(truth):
    measure = yardstick(reference(truth, noise=1e-3), sda_threshold=850.0)
    half = evaluated(truth[:, ::2])
    errors = measure.errors(half, same_sensors=False)
    share = np.mean((truth[:, ::2] >= 850).sum(axis=0) >= TIMES / 2)
    whole = np.mean((truth >= 850).sum(axis=0) >= TIMES / 2)
    assert errors.sda.value == pytest.approx(100 * (share - whole))
    assert np.isnan(errors.square.value)
    assert np.isnan(errors.direct_sun.value)


def test_jackknife_of_a_mean_is_its_standard_error():
    x = np.random.default_rng(5).random(30)
    estimate = jackknife(lambda rounds: float(x[rounds].mean()), 30)
    assert estimate.value == pytest.approx(x.mean())
    assert estimate.error == pytest.approx(x.std(ddof=1) / np.sqrt(30))


def test_pairs_of_equal_rounds_do_not_count():
    products = np.array([[9.0, 1.0, 2.0], [1.0, 9.0, 3.0], [2.0, 3.0, 9.0]])
    assert mean_square(products, np.arange(3)) == pytest.approx(2)


# ---- table and picture --------------------------------------------------------------------------


def errors(rms, hidden=False):
    square = (rms / 100) ** 2
    spread = 4 * square if hidden else square / 20
    return Errors(
        Estimate(square, spread), Estimate(-0.2, 0.1), Estimate(0.5, 0.2), Estimate(-0.2),
        Estimate(0.01), Estimate(0.0),
    )  # fmt: skip


def rows():
    unknown = Estimate(float("nan"), float("nan"))
    grid = replace(errors(1.0), square=unknown, mean=unknown, direct_sun=unknown)
    numbers = [
        ("default, yours", "default", 4.0, 3.0), ("samples × 1/4", "samples", 2.0, 6.0),
        ("cells 0.9 m", "cell size", 3.8, 3.4), ("sky MF 2", "sky", 5.0, 2.9),
        ("three-phase", "sun model", 1.0, 30.0), ("film −1 level", "film", 3.9, 5.0),
        ("samples × 2", "samples", 8.0, 0.4),
    ]  # fmt: skip
    done = [
        Row(name, varied, "done", errors(rms, hidden=rms < 1), seconds, 1 << 30)
        for name, varied, seconds, rms in numbers
    ]
    failed = Row("cells 0.15 m", "cell size", "failed: SIGKILL")
    return (*done, Row("spacing × 2", "sensor spacing", "done", grid, 2.0, 1 << 29), failed,
            Row("sky MF 6", "sky"))  # fmt: skip


def known_yardstick(own_rms, mean, sda, ase, rounds, **reference):
    """A reference whose numbers are given."""
    return SimpleNamespace(
        own_rms=own_rms, mean=Estimate(*mean), sda=Estimate(*sda), ase=ase, count=rounds,
        reference=SimpleNamespace(**reference),
    )  # fmt: skip


@pytest.fixture
def room_tradeoff():
    known = known_yardstick(
        1.2, mean=(800.0, 0.8), sda=(55.0, 0.5), ase=12.0, rounds=16,
        method="path tracing", seconds=60.0, times=range(201), sensors=range(576),
    )  # fmt: skip
    return Tradeoff("room", rows(), known, 2610)


def tradeoff_of(rows):
    known = known_yardstick(
        1.0, mean=(500.0, 0.5), sda=(60.0, 1.0), ase=5.0, rounds=4,
        method="path tracing", seconds=9.0, times=range(20), sensors=range(12),
    )  # fmt: skip
    return Tradeoff("room", tuple(rows), known, 200)


def test_points_that_tell_nothing_are_remarked_upon():
    some = [row for row in rows() if row.is_on_plot]
    hidden = [replace(row, errors=errors(0.4, hidden=True)) for row in some]
    assert len(tradeoff_of(some).notes()) == 3
    assert "compared: 2, too few" in tradeoff_of(some[:2]).notes()[-1]
    assert "noise of the reference hides all errors" in tradeoff_of(hidden).notes()[-1]


def test_it_is_said_beforehand_how_many_settings_fit():
    assert announcement(20, 5.0, 10.0) == "about 20 of 20 settings fit into 10 min"
    short = announcement(20, 5.0, 2.0)
    assert short == "about 6 of 20 settings fit into 2 min; all of them need about --minutes 7"


def test_csv_is_whole(room_tradeoff, tmp_path):
    room_tradeoff.save(tmp_path / "new")
    table = pd.read_csv(tmp_path / "new" / "tradeoff.csv").set_index("setting")
    assert list(table.index) == ["reference", *(row.name for row in room_tradeoff.rows)]
    assert table.loc["default, yours", "E_rms_percent"] == pytest.approx(3.0)
    assert table.loc["default, yours", "memory_MiB"] == 1024
    assert np.isnan(table.loc["spacing × 2", "E_rms_percent"])
    assert table.loc["spacing × 2", "sDA_points"] == 0.5
    assert table.loc["sky MF 6", "status"] == "not run"
    assert np.isnan(table.loc["sky MF 6", "seconds"])
    assert table.loc["reference", "E_rms_percent"] == 1.2
    assert {f.name for f in (tmp_path / "new").iterdir()} == {"tradeoff.csv", "tradeoff.png"}


def test_it_shows_itself(room_tradeoff):
    page = room_tradeoff._repr_html_()
    for text in ("samples × 1/4", "&lt;", "201 of 2610", "data:image/png"):
        assert text in page


def test_cells_say_what_is_unknown():
    by_name = {row.name: row.cells() for row in rows()}
    assert by_name["samples × 2"][1].startswith("< ")
    assert by_name["spacing × 2"][1:3] == ("–", "–")
    assert by_name["sky MF 6"][1] == "not run"
    assert by_name["cells 0.15 m"][1] == "failed: SIGKILL"


def test_nothing_beats_the_frontier():
    seconds, error = np.array([4.0, 2.0, 3.0, 5.0, 2.0]), np.array([1.0, 3.0, 3.5, 1.0, 4.0])
    assert pareto(seconds, error).tolist() == [1, 0]


def test_labels_lie_apart_within_the_picture():
    figure = frontier("room", rows(), 1.2)
    figure.canvas.draw()
    ax = figure.axes[0]
    shown = [row.name for row in rows() if row.is_on_plot]
    texts = [t for t in ax.texts if t.get_text()]
    assert sorted(t.get_text() for t in texts) == sorted(shown)
    boxes = [t.get_window_extent() for t in texts]
    for i, a in enumerate(boxes):
        assert ax.get_window_extent().padded(2).contains(a.x0, a.y0)
        assert ax.get_window_extent().padded(2).contains(a.x1, a.y1)
        for b in boxes[:i]:
            assert not a.overlaps(b)


def test_a_picture_without_points_says_so():
    figure = frontier("room", [Row("default", "default")], 1.2)
    assert figure.axes[0].texts[0].get_text() == "no setting was reached"


# ---- processes ----------------------------------------------------------------------------------


def test_a_job_without_an_end_is_stopped(tmp_path):
    """Stopped, rather than waited for: nothing is written."""
    end = tmp_path / "end"
    job = partial(exec, f"import time; time.sleep(20); open({str(end)!r}, 'w').close()", {})
    with pytest.raises(TimeoutError):
        process.run(job, time.monotonic() + 0.5)
    assert not end.exists()


def test_a_job_that_dies_says_why():
    with pytest.raises(process.JobError, match="SIGABRT"):
        process.run(partial(os.abort), time.monotonic() + 30)
    with pytest.raises(process.JobError, match="exit code 1: ValueError: invalid literal"):
        process.run(partial(int, "x"), time.monotonic() + 30)


def test_what_is_wrong_with_the_input_comes_back():
    case = room(weather={"file": "/none.epw"})
    with pytest.raises(InputError) as error:
        process.run(partial(load_case, "/none.toml"), time.monotonic() + 30)
    assert (error.value.source, error.value.field) == ("/none.toml", "case file")
    with pytest.raises(InputError, match="no such file"):
        tradeoff(case)


@pytest.mark.parametrize("minutes", [0, -1, float("nan"), float("inf")])
def test_no_time_is_refused(minutes):
    with pytest.raises(InputError, match="minutes"):
        tradeoff(room(), minutes=minutes)


@pytest.mark.parametrize("rounds", [4, 48])
def test_a_reference_by_samples_tells_how_many_photons_it_has(rounds):
    """Where patches of finer skies share photons, it told four times as many."""
    case = load_case("lightpipe/lightpipe")

    def by_sky(one):
        a, subdivision = one.accuracy, one.sky.subdivision
        each = of_patch(a.photons, subdivision)
        return a.replicates * each * len(of_sky(subdivision).bins)

    sent = rounds * by_sky(finer_samples._finer(case, 0)) / by_sky(finer_samples.default(case))
    assert finer_samples._photons(case, rounds) == pytest.approx(sent, rel=0.01)
