"""A case with each of the sun models: what it gives, what lies on disk, what can be used again."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import load_case
from drcmitsuba.annual.applied_states import applied_states
from drcmitsuba.annual.run import Run
from drcmitsuba.metrics import evaluate_metrics, illuminance, stored_arrays
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.plan import plan
from drcmitsuba.runtime import provenance, storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import luminances
from tests.fast import slowly
from tests.system.small_room import CASE, DAYS, SHADING, changed

MODELS = ["true_sun", "three_phase", "five_phase", "daysim", "adaptive"]


def case_of(folder, model, *changes, subdivision=1):
    text = changed(*changes) + f'\n[sun]\nmodel = "{model}"\n[sky]\nsubdivision = {subdivision}\n'
    file = folder / f"{model}.toml"
    file.write_text(text)
    return load_case(file)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Result of each model."""
    folder = tmp_path_factory.mktemp("models")
    return {model: drcmitsuba.evaluate(case_of(folder, model)) for model in MODELS}


@pytest.mark.parametrize("model", slowly(MODELS, *MODELS[1:3]))
def test_files_on_disk_give_the_same_illuminance(results, tmp_path, model):
    result = results[model]
    storage.save_zarr(result.coefficients, tmp_path / "C.zarr")
    luminances.save_luminances(result.daylight, tmp_path / "L.zarr")
    C = stored_arrays.open_dataset(tmp_path / "C.zarr", "replicates").load()
    L = luminances.from_luminances(stored_arrays.open_dataset(tmp_path / "L.zarr", "L", "sun"))
    E = illuminance.illuminance(Coefficients.of(C), L)
    for name, expected in result.illuminance.data_vars.items():
        np.testing.assert_allclose(E[name], expected, rtol=1e-4, atol=0.05, err_msg=name)


@pytest.mark.parametrize("model", MODELS[:-1])
def test_illuminance_is_coefficients_times_luminances(results, model):
    result = results[model]
    L = result.sky["L"]
    C = result.coefficients["replicates"].sel(state="open").mean("replicate")
    assert list(C["bin"].values) == list(L["bin"].values)
    E = L.values.astype(float) @ C.values.T.astype(float)
    np.testing.assert_allclose(result.illuminance["total_open"], E, rtol=1e-4, atol=0.05)


def test_the_adaptive_sun_has_no_bin_in_the_sky(results):
    sky = results["adaptive"].sky
    assert sky.sizes["bin"] == 146
    assert {"sun", "sun_direction", "sun_bin"} <= set(sky.variables)


def test_all_models_give_much_the_same_light_and_only_some_the_same_sun(results):
    exact = results["true_sun"].illuminance
    direct = exact["direct_sun"] >= 1000
    wrong = {}
    for model in MODELS[1:]:
        E = results[model].illuminance
        assert float(E["total_open"].mean()) == pytest.approx(
            float(exact["total_open"].mean()), rel=0.12
        )
        wrong[model] = float(((E["direct_sun"] >= 1000) != direct).mean())
    assert wrong["adaptive"] < 0.002 < wrong["five_phase"] < 0.02
    assert wrong["three_phase"] > 0.02
    assert wrong["daysim"] > 0.02


@pytest.mark.parametrize("model", MODELS)
def test_shades_close_by_direct_sun_alone_as_in_an_evaluation(results, model):
    """Glare and pictures simulate the direct sun alone; patches may stand for it."""
    result = results[model]
    light, run = result.daylight, Run.of(result.case)
    run = replace(run, enabled_effects=plan(result.case, light).scope)
    applied = applied_states(result.case, light, run)
    closed = result.illuminance["shade_closed"].values.ravel() > 0
    assert 0.05 < closed.mean() < 0.95
    # Directions on the edges of disks are drawn anew.
    assert (applied.taken.index.ravel() > 0)[closed].mean() > 0.98
    assert (applied.taken.index.ravel() > 0)[~closed].mean() < 0.02


def test_patches_that_stand_for_the_sun_close_groups_of_known_elements(tmp_path):
    two_sides = """
[facade.east]
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[groups.south]
panes = ["*"]
facing = "south"
states = ["shade"]
[groups.east]
panes = ["*"]
facing = "east"
states = ["shade"]
"""
    case = case_of(tmp_path, "three_phase", (DAYS, "months = [3]"), (SHADING, two_sides))
    whole, summed = drcmitsuba.evaluate(case), drcmitsuba.elements(case).evaluate()
    closed, again = ((r.illuminance["facade_state"] > 0).mean("time") for r in (whole, summed))
    assert float(closed.min()) > 0.05
    np.testing.assert_allclose(again, closed, atol=0.03)
    E, exact = summed.illuminance, whole.illuminance
    error = np.hypot(E["total_se"], exact["total_se"]) + 1
    assert float((((E["total"] - exact["total"]) / error) ** 2).mean()) < 4


def test_the_adaptive_sun_tells_its_error(results):
    C = results["adaptive"].coefficients
    assert 0 <= C.attrs["mesh_miss"] < 0.1
    assert C.attrs["mesh_suns"] == sum(str(b).startswith("sun_mesh") for b in C["bin"].values)
    E, exact = (results[m].illuminance for m in ("adaptive", "true_sun"))
    error = np.hypot(E["sun_open_se"], exact["sun_open_se"]) + 1
    z = (E["sun_open"] - exact["sun_open"]) / error
    assert float((z**2).mean()) < 4


def test_a_finer_sky_is_a_setting(tmp_path):
    case = case_of(tmp_path, "three_phase", (DAYS, "months = [3]"), subdivision=2)
    result = drcmitsuba.evaluate(case)
    assert result.coefficients.sizes["bin"] == 578
    np.testing.assert_allclose(
        result.illuminance["sky_open"] + result.illuminance["sun_open"],
        result.illuminance["total_open"],
        rtol=1e-4,
    )


# ---- use again --------------------------------------------------------------------------------


def test_a_mesh_serves_another_weather(results, tmp_path, monkeypatch):
    mesh = results["adaptive"].coefficients
    other = case_of(tmp_path, "adaptive", (DAYS, "months = [4]"))
    fresh = drcmitsuba.evaluate(other)

    def refuse(*args, **options):
        raise AssertionError("nothing is gathered anew")

    monkeypatch.setattr("drcmitsuba.annual.simulation.meshed", refuse)
    again = drcmitsuba.evaluate(other, known=mesh)
    for name in fresh.illuminance.data_vars:
        xr.testing.assert_allclose(again.illuminance[name], fresh.illuminance[name], rtol=1e-4)
    assert again.metrics["sDA"] == fresh.metrics["sDA"]


def test_coefficients_of_another_case_are_not_used(results, tmp_path):
    known = results["adaptive"].coefficients
    other = case_of(tmp_path, "adaptive", ("transmittance = 0.65", "transmittance = 0.66"))
    with pytest.raises(InputError, match="another case or accuracy; compute them anew"):
        drcmitsuba.evaluate(other, known=known)


@pytest.mark.parametrize("method", [None, provenance.METHOD - 1])
def test_coefficients_of_another_method_are_not_used(results, tmp_path, method):
    known = results["adaptive"].coefficients
    known = known.assign_attrs(method=method)
    words = "of an older version" if method is None else f"{method}, not {method + 1}"
    with pytest.raises(InputError, match=f"coefficients: method: {words}; compute them anew"):
        drcmitsuba.evaluate(case_of(tmp_path, "adaptive"), known=known)


def test_a_mesh_of_another_latitude_is_not_used(results, tmp_path):
    known = results["adaptive"].coefficients
    moved = known.assign_attrs(latitude=known.attrs["latitude"] + 5)
    with pytest.raises(InputError, match="latitude"):
        drcmitsuba.evaluate(case_of(tmp_path, "adaptive"), known=moved)


def test_true_suns_of_other_hours_are_added_to_those_that_are_known(results, tmp_path):
    known = results["true_sun"].coefficients
    other = case_of(tmp_path, "true_sun", (DAYS, "months = [5, 6]"))
    again, fresh = drcmitsuba.evaluate(other, known=known), drcmitsuba.evaluate(other)
    E, exact = again.illuminance, fresh.illuminance
    np.testing.assert_allclose(E["sky_open"], exact["sky_open"], rtol=1e-4, atol=0.05)
    error = np.hypot(E["sun_open_se"], exact["sun_open_se"]) + 1
    assert float((((E["sun_open"] - exact["sun_open"]) / error) ** 2).mean()) < 4


@pytest.mark.parametrize("model", MODELS)
def test_the_mean_illuminance_is_that_of_the_year(results, model):
    result = results[model]
    case, light = result.case, result.daylight
    draws = evaluate_metrics.evaluate_metrics(case, light, result.by_state).draws
    E = result.illuminance["total"]
    assert draws.mean_illuminance.value == pytest.approx(float(E.mean()), rel=1e-4)


@pytest.mark.parametrize("model", slowly(["adaptive", "daysim"], "adaptive"))
def test_a_coloured_case_has_a_mesh_as_well(tmp_path, model):
    room = ("size = [4.0, 5.0, 3.0]", "size = [4.0, 5.0, 3.0]\nwalls = [0.6, 0.5, 0.3]")
    case = case_of(tmp_path, model, room, (DAYS, "months = [3]"))
    result = drcmitsuba.evaluate(case)
    again = drcmitsuba.evaluate(case, known=result.coefficients)
    np.testing.assert_allclose(again.illuminance["total"], result.illuminance["total"], rtol=1e-4)
    assert result.illuminance["total"].sizes["channel"] == 3
    for numbers in (result.metrics, again.metrics):
        assert numbers["sDA"]["low"] <= numbers["sDA"]["value"] <= numbers["sDA"]["high"]


def test_an_unknown_model_is_refused(tmp_path):
    (tmp_path / "case.toml").write_text(CASE + '\n[sun]\nmodel = "true"\n')
    with pytest.raises(InputError, match=r'sun.model: got "true"; choose from: .*"adaptive"'):
        load_case(tmp_path / "case.toml")


def test_sky_and_sun_may_leave_out_their_model(tmp_path):
    (tmp_path / "case.toml").write_text(CASE + "\n[sky]\nsubdivision = 4\n[sun]\n")
    case = load_case(tmp_path / "case.toml")
    assert (case.sky.model, case.sky.subdivision, case.sun.model) == ("perez", 4, "true_sun")
