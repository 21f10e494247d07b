"""A new version reads what version 0.1.0 left, or says that it makes it anew."""

import json
import shutil

import pytest
import xarray as xr

from drcmitsuba.annual import attributes, simulation
from drcmitsuba.runtime import provenance, storage
from tests.system.small_room import CASE, SITE, run

OLDER = provenance.METHOD - 1
SHORT = CASE.replace("months = [3, 6]", "months = [3]\nhours = [11, 13]") + SITE
SHORT = SHORT.replace("[5, 5]", "[3, 3]")


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    """Folder with a case, its results and its cache, as version 0.1.0 made them."""
    folder = tmp_path_factory.mktemp("left")
    (folder / "case.toml").write_text(SHORT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(provenance, "METHOD", OLDER)
        patch.setattr(attributes, "METHOD", OLDER)
        patch.setattr(attributes, "RELEASE", "0.1.0")
        cache = ("--cache", folder / "cache")
        run(patch, "evaluate", folder / "case.toml", "-o", folder / "results", *cache)
    path = folder / "results" / "illuminance.nc"
    with xr.open_dataset(path, engine="h5netcdf") as data:
        E = data.load()
    del E.attrs["method"]  # it wrote none
    storage.save_netcdf(E, path)
    return folder


@pytest.fixture
def older(left, tmp_path):
    return shutil.copytree(left, tmp_path / "left")


def test_blocks_of_the_cache_are_made_anew_with_a_line(older, monkeypatch, capsys):
    command = "evaluate", older / "case.toml", "-o", older / "new", "--cache", older / "cache"
    capsys.readouterr()
    run(monkeypatch, *command)
    line = f"blocks in {older / 'cache'} are of another version or variant, and made again"
    assert line in capsys.readouterr().err
    assert json.loads((older / "new" / "metrics.json").read_text("utf-8"))["sDA"]
    run(monkeypatch, *command)
    assert "going on from" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [("comply", "results", "--standard", "lm-83-12"), ("report", "results")],
)
def test_results_are_not_judged(older, refused, monkeypatch, command):
    monkeypatch.chdir(older)
    line = refused(*command)
    start = f"results/illuminance.nc: method: {OLDER}, of version 0.1.0, not {provenance.METHOD}"
    assert line == f"{start}; evaluate the case again"


def test_results_of_the_same_method_are_judged(older, monkeypatch):
    """Whatever their version: 0.1.0 named the method in its coefficients."""
    for name in (".zattrs", ".zmetadata"):
        file = older / "results" / "coefficients.zarr" / name
        text = file.read_text("utf-8")
        assert text.count(f'"method": {OLDER}') == 1
        file.write_text(text.replace(f'"method": {OLDER}', f'"method": {provenance.METHOD}'))
    run(monkeypatch, "report", older / "results", "-o", older / "page.html")
    assert (older / "page.html").stat().st_size > 0


def test_results_are_shown(older, monkeypatch, capsys):
    run(monkeypatch, "plot", older / "results")
    run(monkeypatch, "metrics", older / "results" / "illuminance.nc")
    assert "sDA" in capsys.readouterr().out


def test_coefficients_are_not_used(older, refused):
    known = ("--coefficients", older / "results" / "coefficients.zarr")
    line = refused("evaluate", older / "case.toml", "-o", older / "new", *known)
    assert line.endswith(f"method: {OLDER}, not {simulation.METHOD}; compute them anew")
