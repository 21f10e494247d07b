"""The report with what stands beside an evaluation: who lights points, glare, pictures."""

import csv
import io
import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from PIL import Image

import drcmitsuba
from drcmitsuba.report.document import Report
from tests import browser, skips
from tests.system.small_room import CASE
from tests.system.stored_lights import EXPOSURE, write_light_of_sensors, write_lights

GLARE = {
    "DGP": {
        "open": {
            "<i>desk": {
                "above": {"0.35": {"value": 7.5, "low": 6.0, "high": 9.0}},
                "class": "medium",
                "probability": {"high": 0.0, "medium": 0.93, "none": 0.07},
            }
        }
    }
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of a small room, with lights, glare and pictures."""
    folder = tmp_path_factory.mktemp("beside")
    (folder / "case.toml").write_text(CASE.replace("[3, 6]", "[3]\nhours = [11, 13]"))
    drcmitsuba.evaluate(folder / "case.toml").save(folder / "r")
    write_lights(folder / "r")
    write_light_of_sensors(folder / "r")
    (folder / "r" / "glare.json").write_text(json.dumps(GLARE))
    noise = np.random.default_rng(1).integers(0, 255, (1500, 2000, 3), dtype=np.uint8)
    Image.fromarray(noise).save(folder / "r" / "desk 03-21.png")
    (folder / "r" / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\nno picture")
    return folder / "r"


@pytest.fixture(scope="module")
def page(results):
    Report.of_folders([results]).save(results.parent / "report.html")
    return results.parent / "report.html"


@pytest.fixture
def copied(results, tmp_path):
    return shutil.copytree(results, tmp_path / "copied")


def test_the_page_holds_them_as_text_and_small_pictures(page):
    text = page.read_text("utf-8")
    assert len(text.encode()) < 2_000_000
    assert text.count("<img ") == 1
    assert "desk 03-21" in text
    assert "broken" not in text
    assert "img-src data:" in text
    assert "&lt;i&gt;desk" in text
    assert "<i>desk" not in text
    assert "hours with DGP above 0.35" in text
    assert "film &lt;b&gt;" in text
    assert "93.0 %" in text


def test_markdown_has_them_too(results):
    text = Report.of_folders([results]).markdown()
    assert "Who lights this point?" in text
    assert "\\<i\\>desk" in text


def test_csv_has_lights_and_glare(results):
    rows = [*csv.DictReader(io.StringIO(Report.of_folders([results]).csv()))]
    lights = [row for row in rows if row["metric"].startswith("light from")]
    of_sensor = [float(row["value"]) for row in lights if row["space"] == "point 12"]
    assert sum(of_sensor) == pytest.approx(sum(map(sum, EXPOSURE.values())))
    assert {row["unit"] for row in lights} == {"lx h"}
    (glare,) = (row for row in rows if row["metric"] == "DGP above 0.35, open")
    assert [float(glare[key]) for key in ("value", "low", "high")] == [7.5, 6.0, 9.0]
    assert "probability of class medium, open" in {row["metric"] for row in rows}


def test_glare_of_another_facade_is_left_out(copied):
    """As where the glass was changed and the glare was not computed again."""
    settings = json.loads((copied / "metrics.json").read_text())["settings"]
    for change, kept in (({}, True), ({"seed": 7}, True), ({"materials": {}}, False),
                         ({"period": {}}, False), ({"views": {"a": {}}}, True)):  # fmt: skip
        glare = GLARE | {"settings": settings | change}
        (copied / "glare.json").write_text(json.dumps(glare))
        shutil.copy(copied / "desk 03-21.png", copied / "glare_year.png")
        report = Report.of_folders([copied])
        (facade,) = report.facades
        assert (facade.glare is not None) == kept
        assert ("glare_year" in report.html()) == kept
        assert any("glare.json is of another" in note for note in facade.notes) != kept


def test_pictures_older_than_the_evaluation_are_told(copied):
    evaluated = (copied / "metrics.json").stat().st_mtime
    for age, told in ((-10, False), (3600, True)):
        os.utime(copied / "desk 03-21.png", 2 * (evaluated - age,))
        (facade,) = Report.of_folders([copied]).facades
        assert any("of another façade: desk 03-21.png" in note for note in facade.notes) == told


def test_the_browser_tells_who_lights_the_nearest_traced_point(page, tmp_path_factory):
    skips.BROWSER.skip_if_so()
    with browser.page(tmp_path_factory.mktemp("profile")) as opened:
        opened.open(page)
        options = opened("[...document.getElementById('traced').options].map((o) => o.textContent)")
        assert options[0].startswith("point 0 at (")
        assert options[1].startswith("point 12 at (")
        opened("document.getElementById('traced').value = '0'")
        opened("document.getElementById('traced').dispatchEvent(new Event('change'))")
        opened("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        told = opened("document.getElementById('dome-map-text-0').textContent")
        whole = sum(map(sum, EXPOSURE.values()))
        assert told.startswith("traced point 0, 0.00 m from the chosen one")
        for window, light in EXPOSURE.items():
            assert f"{window} {100 * sum(light) / whole:.1f}".removesuffix(".0") in told
        shown = opened("document.getElementById('dome-map-0').toDataURL().length")
        assert shown > 10_000
        cells = opened("[...document.querySelectorAll('#light data')].map((e) => +e.value)")
        sun, sky, ground = (EXPOSURE["glass (south)"][i] for i in (2, 1, 0))
        shares = [sun / 4, 3 * sun / 4, sky / 4, 3 * sky / 4, ground, sun + sky + ground]
        assert cells[:6] == pytest.approx([100 * part / whole for part in shares])
        assert opened.complaints == []
        assert [u for u in opened.requests if not u.startswith(("file:", "data:"))] == []


def test_the_browser_tells_who_lights_the_chosen_point(page, tmp_path_factory):
    skips.BROWSER.skip_if_so()
    with browser.page(tmp_path_factory.mktemp("profile")) as opened:
        opened.open(page)
        opened("document.getElementById('traced').value = '1'")
        opened("document.getElementById('traced').dispatchEvent(new Event('change'))")
        opened("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        told = opened("document.getElementById('point-map-text-0').textContent")
        number = int(told.split(",")[0].removeprefix("point "))
        first, film = (np.array(light) for light in EXPOSURE.values())
        whole = first.sum() + number * film.sum()
        assert number == 12
        film_share, glass_share = re.search(
            r"film <b> ([\d.]+) %.*glass \(south\) ([\d.]+) %", told
        ).groups()
        # Five parts of each window are kept to 0.1 %.
        assert float(film_share) == pytest.approx(100 * number * film.sum() / whole, abs=0.25)
        assert float(glass_share) == pytest.approx(100 * first.sum() / whole, abs=0.25)
        assert f"ground {100 * first[0] / whole:.1f})" in told


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.assign_attrs(settings="other"),
        lambda d: d.isel(sensor=slice(1, None)),
        lambda d: d.assign(exposure=d["exposure"] * np.nan),
        lambda d: d.assign(exposure=d["exposure"].sum("source")),
        lambda d: d.drop_vars("exposure"),
    ],
)
def test_damaged_light_of_all_sensors_is_refused_in_one_line(copied, refused, change):
    with xr.open_dataset(copied / "light_of_sensors.nc", engine="h5netcdf") as data:
        made = change(data.load())
    made.to_netcdf(copied / "light_of_sensors.nc", engine="h5netcdf")
    assert "light_of_sensors.nc" in refused("report", copied)


def test_axe_finds_nothing_serious(page, tmp_path_factory):
    skips.BROWSER.skip_if_so()
    axe = skips.module("axe_core_python")
    rules = (Path(axe.__path__[0]) / "axe.min.js").read_text("utf-8")
    with browser.page(tmp_path_factory.mktemp("profile")) as opened:
        opened.open(page)
        opened(f"{rules}; 0")
        asked = "axe.run().then((r) => r.violations.map((v) => [v.id, v.impact, v.nodes[0].html]))"
        assert opened(asked) == []
        assert opened("axe.run().then((r) => r.passes.length)") > 30


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.assign_attrs(settings="other"),
        lambda d: d.assign_attrs(subdivision=9),
        lambda d: d.assign_coords(sensor=[0, 999]),
        lambda d: d.assign(by_window=d["by_window"] * np.nan),
        lambda d: d.isel(bin=slice(0, 9)),
        lambda d: d.isel(sensor=[0] * 25),
        lambda d: d.assign(exposure=d["exposure"].sum("source")),
    ],
)
def test_damaged_lights_are_refused_in_one_line(copied, refused, change):
    with xr.open_dataset(copied / "lights.nc", engine="h5netcdf") as data:
        made = change(data.load())
    made.to_netcdf(copied / "lights.nc", engine="h5netcdf")
    assert "lights.nc" in refused("report", copied)


@pytest.mark.parametrize("text", ['{"DGP": {"open": {"a": {"above": 1}}}}', "[" * 99_999])
def test_damaged_glare_is_refused_in_one_line(copied, refused, text):
    (copied / "glare.json").write_text(text)
    assert "glare.json: glare:" in refused("report", copied)
