"""Coefficients in a cache serve other weather, thresholds and shades; the command lists them."""

import json

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import load_case
from drcmitsuba.annual.block_parts import make_part
from drcmitsuba.blocks import block_folder
from drcmitsuba.blocks.part import BlockPart
from tests.system.small_room import changed, run

TEXT = changed(
    ("count = [5, 5]", "count = [3, 3]"),
    ("[accuracy]\nreplicates = 4", '[effects]\npictures = "off"\n[accuracy]\nreplicates = 2'),
)


def weather(path, direct):
    """A year of one sky whose sun is as bright as a share says, in the format .wea."""
    lines = ["place test", "latitude 46.25", "longitude -6.13", "time_zone -15"]
    lines += ["site_elevation 420", "weather_data_file_units 1"]
    for day in np.arange("2015-01-01", "2016-01-01", dtype="datetime64[D]"):
        month, of_month = int(str(day)[5:7]), int(str(day)[8:10])
        clear = direct * (of_month % 3 > 0)
        for hour in range(24):
            up = max(0.0, np.sin(np.pi * (hour - 5.5) / 13))
            lines.append(
                f"{month} {of_month} {hour + 0.5} {800 * clear * up**0.3:.0f} {200 * up:.0f}"
            )
    path.write_text("\n".join([*lines, ""]))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Case files, weather files, and a cache that one evaluation has filled."""
    folder = tmp_path_factory.mktemp("cache")
    weather(folder / "one.wea", 1.0)
    weather(folder / "two.wea", 0.6)
    text = TEXT.replace("[period]", '[weather]\nfile = "one.wea"\n[period]')
    (folder / "case.toml").write_text(text)
    drcmitsuba.evaluate(load_case(folder / "case.toml"), blocks=folder / "cache").save(folder / "r")
    return folder


@pytest.fixture
def stored(monkeypatch):
    """List of the blocks that are computed."""
    blocks, write_block = [], block_folder.write_block
    monkeypatch.setattr(
        block_folder, "write_block", lambda *a: write_block(*a) or blocks.append(a[1])
    )
    return blocks


def test_blocks_of_weather_without_sun_lend_no_dark_suns(folder, tmp_path):
    weather(folder / "dull.wea", 0.0)
    text, results = (folder / "case.toml").read_text(), []
    for name in ("dull", "one"):
        path = tmp_path / f"{name}.toml"
        path.write_text(text.replace('"one.wea"', f'"{folder}/{name}.wea"'))
        results.append(drcmitsuba.evaluate(load_case(path), blocks=tmp_path / "cache"))
    dull, sunny = (float(result.illuminance["direct_sun"].max()) for result in results)
    assert dull == 0
    assert sunny > 1000
    with pytest.raises(drcmitsuba.InputError, match="no sun shone in the weather"):
        drcmitsuba.evaluate(load_case(path), known=results[0].coefficients)
    again = drcmitsuba.evaluate(load_case(tmp_path / "dull.toml"), known=results[1].coefficients)
    assert float(again.illuminance["direct_sun"].max()) == 0


def test_parts_and_evaluations_share_their_blocks(folder, stored):
    case = load_case(folder / "case.toml")  # a room into which some suns cannot shine
    make_part(case, block_folder.BlockFolder.cache(folder / "cache"), BlockPart.of("1/1"))
    assert not stored


@pytest.mark.parametrize(
    ("change", "computed"),
    [
        (("one.wea", "two.wea"), 0),
        (('[shading]\nmaterial = "shade"', '[shading]\nmaterial = "shade"\nthreshold = 400.0'), 0),
        (('name = "small room"', 'name = "other"\n[metrics]\nsda_threshold = 200.0'), 0),
        (("transmittance = 0.1\n", "transmittance = 0.2\n"), 1),
        (("transmittance = 0.65", "transmittance = 0.6"), 1),  # the shade stands for the glass
        (("pane_points = 16", "pane_points = 16\nseed = 1"), 2),
    ],
)
def test_only_what_a_change_concerns_is_traced_again(folder, tmp_path, stored, change, computed):
    old, new = change
    text = (folder / "case.toml").read_text().replace(old, new).replace('"one', f'"{folder}/one')
    path = tmp_path / "case.toml"
    path.write_text(text.replace('"two', f'"{folder}/two'))
    result = drcmitsuba.evaluate(load_case(path), blocks=folder / "cache")
    assert len(stored) == computed
    if "two.wea" in new:
        alone = drcmitsuba.evaluate(load_case(path))
        np.testing.assert_allclose(
            result.illuminance["total"], alone.illuminance["total"], rtol=1e-5, atol=1e-2
        )
        assert result.metrics["sDA"] == alone.metrics["sDA"]
        assert result.metrics["ASE"] == alone.metrics["ASE"]
        first = xr.open_dataset(folder / "r" / "illuminance.nc")
        assert abs(first["total"].mean() - result.illuminance["total"].mean()) > 10


def test_the_command_lists_limits_and_prunes(folder, monkeypatch, capsys):
    cache = folder / "cache"
    run(monkeypatch, "cache", cache)
    out = capsys.readouterr().out
    assert "small room, open" in out
    assert "of at most 20 GiB" in out
    run(monkeypatch, "cache", cache, "--limit", "1 GiB")
    assert "removed 0 B" in capsys.readouterr().out
    assert json.loads((cache / "blocks.json").read_text())["limit"] == 1 << 30
    run(monkeypatch, "cache", cache, "--prune", "0 B")
    assert "0 entries, 0 B of at most 1 GiB" in capsys.readouterr().out
    assert list(cache.glob("*/*.zip")) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["cache", "nowhere"], "no such folder"),
        (["cache", "mine"], "other files"),
        (["cache", "cache", "--prune", "a lot"], "write a size"),
        (["evaluate", "case.toml", "--cache", "mine"], "other files"),
        (["evaluate", "case.toml", "--cache", "old"], "its format is 0, not 1"),
        (["evaluate", "case.toml", "--cache", "cache", "--variants", "b"], "beside --variants"),
    ],
)
def test_bad_input_is_refused_in_a_line(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "case.toml").write_text(TEXT)
    for name in ("mine", "old", "cache"):
        (tmp_path / name).mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("mine")
    (tmp_path / "old" / "blocks.json").write_text('{"format": 0}')
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, *arguments)
    assert stop.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
