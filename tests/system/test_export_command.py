"""`drcmitsuba export`: files for other programs from a case and from the folder of its results."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba.export.matrices import matrices
from drcmitsuba.export.radiance import save_radiance
from tests import ROOT
from tests.system.small_room import CASE, DAYS, changed
from tests.unit.export.radiance_text import matrix, primitives

STAMPS = ["2015-01-12T12:00", "2015-03-20T10:00", "2015-06-15T12:00", "2015-12-21T23:00"]
SUNS = ["sun_2015-01-12T12_00", "sun_2015-03-20T10_00", "sun_2015-06-15T12_00"]
SCENE = {
    "materials.rad", "scene.rad", "glazing.cal", "sensors.pts", "sky.rad", "suns.rad", "suns.txt",
    "L_sky.mtx", "L_suns.mtx", "times.txt", "simulate.sh",
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A case of four time stamps, one of them at night, and its results."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "times.csv").write_text("\n".join(["time", *STAMPS]) + "\n")
    (folder / "case.toml").write_text(changed((DAYS, 'timestamps = "times.csv"')))
    drcmitsuba.evaluate(folder / "case.toml").save(folder / "results")
    return folder


def test_a_case_becomes_a_folder_of_radiance(run, folder, tmp_path):
    code, out, err = run("export", folder / "case.toml", "--radiance", tmp_path / "new" / "scene")
    assert (code, err) == (0, "")
    assert "simulate.sh" in out
    made = tmp_path / "new" / "scene"
    assert {file.name for file in made.iterdir()} == SCENE
    materials = primitives((made / "materials.rad").read_text())
    used = {one.modifier for one in primitives((made / "scene.rad").read_text())}
    assert used == {one.name for one in materials}
    assert (made / "suns.txt").read_text().split() == SUNS
    assert (made / "times.txt").read_text().split() == STAMPS
    assert np.loadtxt(made / "sensors.pts").shape == (25, 6)
    L = xr.open_zarr(folder / "results" / "sky.zarr")["L"].values.T
    np.testing.assert_allclose(matrix(made / "L_sky.mtx")[..., 0], L[:146], rtol=1e-6)
    np.testing.assert_allclose(matrix(made / "L_suns.mtx")[..., 0], L[146:] / 1e6, rtol=1e-6)


def test_the_shade_stands_in_front_of_the_glass(run, folder, tmp_path):
    arguments = ("export", folder / "case.toml", "--radiance", tmp_path / "r", "--state", "shaded")
    assert run(*arguments)[0] == 0
    kinds = {one.kind for one in primitives((tmp_path / "r" / "materials.rad").read_text())}
    assert kinds == {"plastic", "trans"}


def test_films_go_with_the_scene_and_differences_are_said(run, tmp_path):
    code, out, _ = run("export", "classroom/reference/o2", "--radiance", tmp_path / "r")
    assert code == 0
    film = ROOT / "scenes" / "films" / "prism.xml"
    assert (tmp_path / "r" / "film_1.xml").read_bytes() == film.read_bytes()
    assert "note: Radiance looks up a BSDF with the viewer as incident" in out
    text = (tmp_path / "r" / "simulate.sh").read_text()
    assert "#   Radiance looks up a BSDF" in text
    assert "-ss 0" in text


def test_a_turned_room_says_so_in_its_script(folder, tmp_path):
    text = (folder / "case.toml").read_text()
    (folder / "turned.toml").write_text(text.replace("size = [", "rotation = 30.0\nsize = ["))
    save_radiance(drcmitsuba.load_case(folder / "turned.toml"), tmp_path / "r")
    said = "the scene is turned clockwise by 30 degrees: its y axis is north"
    assert said in (tmp_path / "r" / "simulate.sh").read_text(encoding="ascii")


def test_a_case_without_suns_has_no_suns_in_its_script(tmp_path):
    sky = '[sky]\nmodel = "cie"\ntype = "overcast"\n[site]\nlatitude = 46\nlongitude = 6\n'
    (tmp_path / "case.toml").write_text(f"{CASE}\n{sky}timezone = 1\n")
    made = save_radiance(drcmitsuba.load_case(tmp_path / "case.toml"), tmp_path / "r")
    assert made.suns == 0
    names = {file.name for file in (tmp_path / "r").iterdir()}
    assert names == SCENE - {"suns.rad", "suns.txt", "L_suns.mtx"}
    assert "suns.oct" not in (tmp_path / "r" / "simulate.sh").read_text()


def test_an_adaptive_sun_becomes_the_true_one(folder, tmp_path):
    case = folder / "adaptive.toml"
    case.write_text((folder / "case.toml").read_text() + '\n[sun]\nmodel = "adaptive"\n')
    assert save_radiance(drcmitsuba.load_case(case), tmp_path / "r").suns == 3
    assert (tmp_path / "r" / "suns.txt").read_text().split() == SUNS


def test_results_become_matrices_and_tables(run, folder, tmp_path):
    code, out, err = run(
        "export", folder / "results", "--matrices", tmp_path / "m",
        "--ill", tmp_path / "e.ill", "--csv", tmp_path / "e.csv",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert out.count("\n") == 3
    E = xr.open_dataset(folder / "results" / "illuminance.nc", engine="h5netcdf")
    assert 0 < E["shade_closed"].values.sum() < 4
    product = matrix(tmp_path / "m" / "C.mtx")[..., 0] @ matrix(tmp_path / "m" / "L.mtx")[..., 0]
    np.testing.assert_allclose(product, E["total"].values.T, rtol=1e-5)
    ill = np.loadtxt(tmp_path / "e.ill")
    assert ill[:, :3].tolist() == [[1, 12, 12], [3, 20, 10], [6, 15, 12], [12, 21, 23]]
    np.testing.assert_allclose(ill[:, 3:], E["total"].values, rtol=1e-5)
    csv = pd.read_csv(tmp_path / "e.csv", header=[0, 1, 2, 3], index_col=0)
    np.testing.assert_allclose(csv.values, E["total"].values, rtol=1e-5)


@pytest.mark.parametrize("model", ["adaptive", "three_phase", "five_phase", "daysim"])
def test_the_product_is_e_with_every_model_of_the_sun(evaluate, stamps, model):
    stamps = stamps(*STAMPS)
    text = changed(stamps, ("count = [5, 5]", "count = [2, 2]"))
    result = evaluate(f'{text}\n[sun]\nmodel = "{model}"\n')
    made = matrices(result.by_state, result.daylight.sky)
    E = result.illuminance["total"].values.T
    np.testing.assert_allclose(made.C @ made.L.toarray(), E, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ([], "command line: export: it does not say as what; choose --radiance, --matrices"),
        (["--csv", "e.csv", "--state", "shaded"], "--state: results have their own weather and"),
        (["--ill", "e.ill", "--weather", "w.epw"], "--weather: results have their own weather"),
        (["--radiance", "r", "--csv", "e.csv"], "--csv: it wants a folder of results, --radiance"),
        (
            ["--radiance", "r", "--state", "ajar"],
            'groups: shade: no state "ajar"; choose from: "open", "shaded"',
        ),
        (["--radiance", ""], "the name is empty"),
        (["--radiance", "scene.rad"], "--radiance: the name of a .rad file; name a folder"),
        (["--csv", "."], "--csv: it is a folder; give the name of a file"),
        (["--ill", "none/e.ill"], "--ill: there is no folder none; make it"),
        (["--radiance", "full"], "full: folder: it holds files already; name a new folder"),
        (["--csv", "e.csv"], "illuminance.nc: results: no such file or folder; run the step"),
        (["--matrices", "m"], "coefficients.zarr: results: no such file or folder; run the step"),
    ],
)
def test_mistakes_are_one_line_and_nothing_is_written(
    refused, folder, tmp_path, monkeypatch, arguments, line
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    assert line in refused("export", folder / "case.toml", *arguments)
    assert [file.name for file in tmp_path.rglob("*")] == ["full", "notes.txt"]


def test_a_shade_that_is_not_there_cannot_close(refused, folder, tmp_path):
    case = folder / "bare.toml"
    case.write_text((folder / "case.toml").read_text().split("[shading]")[0])
    line = refused("export", case, "--radiance", tmp_path / "r", "--state", "shaded")
    assert "shading: shaded, but the case has no shade; add a table [shading]" in line


def test_names_of_a_case_do_not_reach_the_files(run, folder, tmp_path):
    hostile = '$(touch pwned)`touch pwned`; touch \\"pwned\\"\\n!touch pwned\\n'
    text = (folder / "case.toml").read_text()
    text = text.replace('name = "small room"', f'name = "{hostile}"')
    text = text.replace("[materials.glass]", f'[materials."{hostile}"]')
    text = text.replace('material = "glass" }', f'material = "{hostile}" }}')
    (folder / "hostile.toml").write_text(text)
    assert run("export", folder / "hostile.toml", "--radiance", tmp_path / "r")[0] == 0
    for name in ("materials.rad", "scene.rad", "simulate.sh"):
        lines = (tmp_path / "r" / name).read_text(encoding="ascii").splitlines()
        named = [line for line in lines if "touch" in line]
        assert named
        for line in named:
            assert not set("`;!\\'") & set(line)
            assert "$(touch" not in line
            assert not line.startswith("touch")
