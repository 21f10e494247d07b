"""`drcmitsuba report` as a user runs it, and its page in a browser without a network."""

import csv
import io
import json
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba.report.document import Report
from drcmitsuba.report.document.packing import unpacked
from tests import browser, skips
from tests.system.small_room import CASE, DAYS, STRIPS

EVIL = "</script><img src=x onerror=alert(1)> =1+1 | **b**"
LARGEST = 2_000_000


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of the small room, and of one with another glass: 8 to 18 h on every day."""
    folder = tmp_path_factory.mktemp("year")
    out = []
    for name, transmittance in (("clear", 0.65), ("dark", 0.35)):
        text = CASE.replace(DAYS, 'calendar = "LM-83"').replace("= 0.65", f"= {transmittance}")
        (folder / f"{name}.toml").write_text(text.replace("small room", f"{name} room"))
        drcmitsuba.evaluate(folder / f"{name}.toml").save(folder / name)
        out.append(folder / name)
    return out


@pytest.fixture(scope="module")
def page(results, tmp_path_factory):
    """File of the report on both rooms."""
    file = tmp_path_factory.mktemp("page") / "report.html"
    Report.of_folders(results).save(file)
    return file


@pytest.fixture(scope="module")
def opened(page, tmp_path_factory):
    """The report in a browser."""
    skips.BROWSER.skip_if_so()
    with browser.page(tmp_path_factory.mktemp("profile")) as opened:
        opened.open(page)
        yield opened


@pytest.fixture
def copied(results, tmp_path):
    return shutil.copytree(results[0], tmp_path / "copied")


class Elements(HTMLParser):
    """Elements of a page with their attributes."""

    def __init__(self, text):
        super().__init__()
        self.all = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.all.append((tag, dict(attributes)))


def intervals(numbers):
    """Exact values of the metrics as `metrics.json` has them as text."""
    for number in (numbers["sDA"], numbers["ASE"], *numbers["msDA"], *numbers["MSE"]):
        yield from (json.dumps(number[key]) for key in ("value", "low", "high"))


def test_one_page_holds_everything(run, results, tmp_path):
    code, out, err = run("report", *results, "-o", tmp_path / "r.html")
    assert (code, err) == (0, "")
    assert f"the report is in {tmp_path / 'r.html'}" in out
    text = (tmp_path / "r.html").read_text("utf-8")
    assert len(text.encode()) < LARGEST
    elements = Elements(text).all
    assert not [a for _, a in elements if {"src", "onclick", "onload", "style"} & a.keys()]
    assert {a["href"][0] for tag, a in elements if tag == "a"} == {"#"}
    assert "link" not in {tag for tag, _ in elements}
    assert not re.search(r"https?://|//[a-z]+\.", text)
    assert "default-src &#39;none&#39;" in text or "default-src 'none'" in text
    told = {a["value"] for tag, a in elements if tag == "data"}
    for folder in results:
        assert set(intervals(json.loads((folder / "metrics.json").read_text()))) <= told
    for words in ("Does it pass?", "LEED v4.1", "probability", "clear room", "dark room"):
        assert words in text


def test_ids_are_unique_and_labels_lead_to_them(page):
    elements = Elements(page.read_text("utf-8")).all
    ids = [a["id"] for _, a in elements if "id" in a]
    assert len(ids) == len(set(ids))
    named = [a[k] for _, a in elements for k in ("for", "aria-labelledby") if k in a]
    named += [a["href"][1:] for tag, a in elements if tag == "a"]
    assert set(named) <= set(ids)
    images = [a for tag, a in elements if a.get("role") == "img"]
    assert all("aria-label" in a for a in images)


@pytest.mark.slow
def test_the_name_of_the_report_follows_the_format(run, copied):
    for option, name in (
        ((), "report.html"),
        (("--markdown",), "report.md"),
        (("--csv",), "report.csv"),
    ):
        code, _, err = run("report", copied, *option)
        assert (code, err) == (0, "")
        assert (copied / name).is_file()


def test_groups_of_panes_have_their_states(evaluate, stamps, run, tmp_path):
    east = f"[facade.east]\n{STRIPS}\n[materials.glass]"
    times = [f"2015-03-2{day}T{hour:02d}:00" for day in (0, 1) for hour in range(8, 18)]
    text = CASE.replace("[materials.glass]", east).replace(*stamps(*times))
    result = evaluate(text).save(tmp_path / "r")
    assert run("report", tmp_path / "r")[0] == 0
    page = (tmp_path / "r" / "report.html").read_text("utf-8")
    content = page.split('id="drawn">')[1].split("</script>")[0]
    groups = json.loads(content)["facades"][0]["hours"]["groups"]
    assert [group["name"] for group in groups] == ["south", "east"]
    taken = [unpacked(group["state"])[0] for group in groups]
    np.testing.assert_array_equal(np.transpose(taken), result.illuminance["facade_state"])
    assert np.ptp(taken) == 1


def test_csv_has_every_number_with_all_digits(run, results, tmp_path):
    assert run("report", *results, "-o", tmp_path / "r.csv")[0] == 0
    rows = [*csv.DictReader(io.StringIO((tmp_path / "r.csv").read_text("utf-8")))]
    assert {row["facade"] for row in rows} == {"clear room", "dark room"}
    numbers = json.loads((results[1] / "metrics.json").read_text())
    (row,) = (r for r in rows if (r["facade"], r["metric"]) == ("dark room", "sDA"))
    assert [row[key] for key in numbers["sDA"]] == [json.dumps(v) for v in numbers["sDA"].values()]
    months = [r for r in rows if (r["facade"], r["metric"]) == ("dark room", "msDA")]
    assert [r["month"] for r in months] == [str(m) for m in range(1, 13)]
    assert [float(r["value"]) for r in months] == [m["value"] for m in numbers["msDA"]]


def test_markdown_has_the_tables(run, results, tmp_path):
    assert run("report", *results, "-o", tmp_path / "r.md")[0] == 0
    text = (tmp_path / "r.md").read_text("utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| LEED v4.1")]
    assert ["option 1" in row for row in rows] == [True, False]
    assert [row.count("|") for row in rows] == [4, 4]
    assert "\n| --- |" not in text
    assert re.search(
        r"glass \(glazing, transmittance 0.65\).* \| glass \(glazing, transmittance 0.35\)", text
    )
    assert "floor 0.2, walls 0.5, ceiling 0.8" in text
    assert "## What was simulated, and why" in text


def test_a_result_shows_its_report(results, tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    result = drcmitsuba.evaluate(tmp_path / "case.toml")
    shown = result.report()._repr_html_()
    assert shown.startswith("<iframe")
    assert 'sandbox="allow-scripts"' in shown
    assert "<script" not in shown  # the page is an attribute
    assert result.report().save(tmp_path / "new" / "r.html").stat().st_size < LARGEST
    with pytest.raises(drcmitsuba.InputError, match=r"report: \.pdf; end its name in \.html"):
        result.report().save(tmp_path / "new" / "r.pdf")


def test_names_of_strangers_are_text(run, copied, tmp_path):
    file = copied / "metrics.json"
    numbers = json.loads(file.read_text())
    numbers["settings"]["notes"] = [EVIL]
    file.write_text(json.dumps(numbers))
    plan = json.loads((copied / "plan.json").read_text())
    plan[EVIL] = {"on": EVIL, "reason": EVIL, "share": EVIL}
    (copied / "plan.json").write_text(json.dumps(plan))
    assert run("report", copied, "-o", tmp_path / "r.html")[0] == 0
    text = (tmp_path / "r.html").read_text("utf-8")
    assert "<img" not in text
    assert "&lt;img" in text
    assert text.count("<script") == text.count("</script>") == 2


def test_bad_input_ends_in_one_line(refused, results, copied, tmp_path):
    assert "no such folder" in refused("report", tmp_path / "none")
    assert "no illuminance.nc; give a folder of drcmitsuba evaluate" in refused("report", tmp_path)
    for name, said in (("glare.json", "glare.json, but no"), ("sensors.nc", "E was not kept")):
        (tmp_path / "other").mkdir(exist_ok=True)
        (tmp_path / "other" / name).touch()
        assert said in refused("report", tmp_path / "other")
    assert "name a file" in refused("report", copied, "-o", tmp_path / "r.pdf")
    assert "give one of them" in refused("report", copied, "--csv", "--markdown")
    assert "give 1 to" in refused("report", *[copied] * 13)
    assert "there is no folder" in refused("report", copied, "-o", tmp_path / "no" / "r.html")
    (copied / "report.html").mkdir()
    assert "it is a folder" in refused("report", copied)
    shutil.copy(results[1] / "metrics.json", copied)
    assert "another evaluation" in refused("report", copied, "-o", tmp_path / "r.html")
    (copied / "metrics.json").unlink()
    assert "metrics.json" in refused("report", copied, "-o", tmp_path / "r.html")
    assert not (tmp_path / "r.html").exists()


@pytest.mark.parametrize("text", ["", "[]", "{", '{"a": 1}', "[" * 100_000, '{"a": NaN}', "\xff"])
def test_damaged_plans_end_in_one_line(refused, copied, text):
    (copied / "plan.json").write_text(text, encoding="latin-1")
    assert "plan.json: plan:" in refused("report", copied)
    assert not (copied / "report.html").exists()


@pytest.mark.parametrize(
    "change",
    [
        lambda E: E.assign_attrs(version="0.0.1"),
        lambda E: E.assign_attrs(groups="[]"),
        lambda E: E.assign_attrs(groups='{"names": [1], "states": [["open", "shut"]]}'),
        lambda E: E.assign_coords(x=E["x"] * np.nan),
        lambda E: E.assign_coords(x=E["x"] * 1e30, y=E["y"] * 1e30),
        lambda E: E.assign_coords(y=E["y"] * 0),
        lambda E: E.assign(total=E["total"] * np.nan),
        lambda E: E.assign(direct_sun=E["direct_sun"] * np.nan),
        lambda E: E.assign(total=E["total"] * 1e10),
        lambda E: E.isel(sensor=[0]),
        lambda E: E.isel(time=[0]),
        lambda E: E.drop_vars("shade_closed"),
        lambda E: E.assign_coords(shade_closed=E["x"]),
        lambda E: E.assign_coords(shade_closed=("time", ["x"] * E.sizes["time"])),
        lambda E: E.assign_coords(facade_state=(("time", "group"), E["total"].values[:, :3])),
        lambda E: E.assign_attrs(latitude="x"),
        lambda E: E.assign_attrs(step_hours=0.0),
    ],
)
def test_damaged_results_end_in_one_line_or_a_report(run, copied, change):
    path = copied / "illuminance.nc"
    with xr.open_dataset(path, engine="h5netcdf") as data:
        E = data.load()
    change(E).to_netcdf(path, engine="h5netcdf")
    for name in ("coefficients.zarr", "sky.zarr"):
        shutil.rmtree(copied / name)
    code, _, err = run("report", copied)
    assert (code == 0) == (copied / "report.html").exists()
    if code:
        assert code == 2
        assert err.count("\n") == 1


def test_a_folder_without_plan_coefficients_and_sky_has_a_report(run, copied):
    (copied / "plan.json").unlink()
    for name in ("coefficients.zarr", "sky.zarr"):
        shutil.rmtree(copied / name)
    code, _, err = run("report", copied)
    assert (code, err) == (0, "")
    assert "unknown" in (copied / "report.html").read_text("utf-8")


@skips.POSIX.mark
@skips.ORDINARY_USER.mark
def test_a_folder_that_cannot_be_written_is_refused(refused, copied):
    copied.chmod(0o500)
    refused("report", copied)


def test_a_page_without_room_for_the_hours_says_so(opened, page, results, tmp_path, monkeypatch):
    monkeypatch.setattr("drcmitsuba.report.document.report.LARGEST_PAGE", 0)
    Report.of_folders(results).save(tmp_path / "r.html")
    opened.open(tmp_path / "r.html")
    assert "too many for one page" in opened("document.getElementById('hours-error').textContent")
    assert "point" in opened("document.getElementById('point-map-text-1').textContent")
    assert opened.complaints == []
    opened.open(page)


def shown_numbers(opened, selector):
    script = f"[...document.querySelectorAll({selector!r})].map((e) => [e.value, e.textContent])"
    return opened(script)


def test_the_browser_shows_the_numbers_of_the_metrics(opened, results):
    told = shown_numbers(opened, "#metrics data")
    wanted = [json.loads((folder / "metrics.json").read_text()) for folder in results]
    values = [
        numbers[name][key]
        for name in ("sDA", "ASE", "shade_closed")
        for numbers in wanted
        for key in ("value", "low", "high")
    ]
    first, second = wanted
    ends = {"value": "value", "low": "high", "high": "low"}
    apart = [
        second[name][key] - first[name][other]
        for name in ("sDA", "ASE", "shade_closed")
        for key, other in ends.items()
    ]
    shown = [f"{v:+.1f}".replace("-", "−") for v in apart]
    expected = [[json.dumps(v), f"{v:.1f}"] for v in values]
    assert told == expected + [[json.dumps(v), one] for v, one in zip(apart, shown, strict=True)]
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith("file:")] == []


def test_the_slider_moves_the_hour(opened, results):
    path = results[0] / "illuminance.nc"
    with xr.open_dataset(path, engine="h5netcdf") as E:
        total, clock = E["total"].values, E["clock"].values
        closed = E["shade_closed"].values
    opened("document.getElementById('hour').focus()")
    before = int(opened("document.getElementById('hour').value"))
    assert str(clock[before])[:13].endswith("T12")
    opened.press("ArrowRight", 39)
    now = int(opened("document.getElementById('hour').value"))
    assert now == before + 1
    assert "13:00" in opened("document.getElementById('hour').getAttribute('aria-valuetext')")
    text = opened("document.getElementById('hour-map-text-0').textContent")
    assert text.startswith(f"mean {total[now].mean(dtype=float):.0f} lx")
    assert text.endswith("shaded" if closed[now] else "open")
    opened("document.getElementById('after').click()")
    assert int(opened("document.getElementById('hour').value")) == now + 10  # the next day
    assert opened.complaints == []


def test_the_keyboard_chooses_a_point(opened, results):
    with xr.open_dataset(results[0] / "illuminance.nc", engine="h5netcdf") as E:
        total = E["total"].values
    opened("document.getElementById('plan-map-0').focus()")
    first = opened("document.getElementById('point-live').textContent")
    for key, code in (("ArrowUp", 38), ("ArrowDown", 40), ("ArrowRight", 39), ("ArrowLeft", 37)):
        opened.press(key, code)
    told = opened("document.getElementById('point-live').textContent")
    number = int(re.search(r"point (\d+)", told)[1])
    mean = total[:, number].mean(dtype=float)
    assert f"mean {mean:.0f} lx" in told
    assert f"300 lx in {100 * (total[:, number] >= 300).mean():.1f} %" in told
    assert first.startswith("clear room: point ")
    assert opened.complaints == []


def test_the_plans_have_colours_of_what_is_chosen(opened):
    script = """(() => {
      const canvas = document.getElementById("plan-map-1");
      return canvas.toDataURL();
    })()"""
    drawn = set()
    for key in ("mean", "enough", "in_sun", "sDA"):
        opened(
            f"document.getElementById('shown').value = '{key}';"
            "document.getElementById('shown').dispatchEvent(new Event('change'))"
        )
        drawn.add(opened(script))
    assert len(drawn) == 4
    assert opened.complaints == []


def test_every_control_has_a_name(opened):
    tree = opened.send("Accessibility.getFullAXTree")["nodes"]
    roles = {"slider", "button", "combobox", "img", "image", "link", "table", "region"}
    nameless = [
        node["role"]["value"]
        for node in tree
        if not node.get("ignored") and node["role"]["value"] in roles
        and not node.get("name", {}).get("value")
    ]  # fmt: skip
    assert nameless == []
