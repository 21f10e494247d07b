"""Parts of the report: packed arrays, tables, words, and what a page may hold."""

import json
import re
import string
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.case.schedule import Schedule
from drcmitsuba.model.materials import GlazingMaterial, Lambertian
from drcmitsuba.report.document import record, spaces, tables
from drcmitsuba.report.document.charts import _runs
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.packing import STEPS, levels, packed, unpacked
from drcmitsuba.report.document.report import _environment, _inert
from drcmitsuba.report.document.table import Number, PageTable, interval, share, text
from drcmitsuba.standards.deciding import WORDS
from tests import ROOT

TEMPLATES = Path(record.__file__).parent / "templates"


@pytest.mark.parametrize("most", [1, 255, 256, 65_535, 65_536, 2**32 - 1])
def test_packed_numbers_come_back_exactly(most):
    values = np.random.default_rng(1).integers(0, most, (7, 13), endpoint=True)
    values[0, 0], values[-1, -1] = most, 0
    array = packed(values)
    assert array["bytes"] == (1 if most < 256 else 2 if most < 65_536 else 4)
    np.testing.assert_array_equal(unpacked(array), values)


def test_negative_and_single_numbers_and_truth_values_are_packed():
    of_a_map = np.array([6_000_000_123, 6_000_000_000])
    for values in (np.array([-5000, 3, 0]), np.array([[True, False]]), np.array([7]), of_a_map):
        np.testing.assert_array_equal(unpacked(packed(values)).ravel(), values.ravel())


def test_levels_are_as_close_as_they_say():
    E = np.geomspace(1.0, 90_000.0, 6000).reshape(60, 100)
    E[0, 0] = 0.3
    for most in (10**9, 12_000, 6_000):
        shown = levels(E, most)
        number = unpacked(shown.light)
        lux = np.where(number > 0, (1 + shown.step) ** (number - 1.0), 0)
        assert lux[0, 0] == 0
        assert abs(lux / E - 1).ravel()[1:].max() <= shown.error
        assert len(shown.light["text"]) <= most
    assert levels(E, 10**9).step == STEPS[0]
    assert levels(E, 100) is None


def test_numbers_keep_their_digits():
    cell = interval({"value": 70.48611111111111, "low": 70.0, "high": 71.25})
    assert "".join(map(str, cell)) == "70.5 (70.0 … 71.2) %"
    assert [part.exact for part in cell if isinstance(part, Number)] == [
        "70.48611111111111", "70.0", "71.25",
    ]  # fmt: skip
    assert str(Number(-3.84, signed=True)) == "−3.8"
    assert str(Number(3.84, signed=True)) == "+3.8"
    assert interval(None) == ("–",)
    assert share(0.174) == "17.4 %"
    assert {share(bad) for bad in (None, True, "x", -1, 1e300, float("nan"))} == {"–"}


def test_all_text_is_escaped_in_html_and_markdown():
    evil = "</script><script>alert(1)</script>| `x` [a](javascript:b)"
    it = PageTable(evil, (evil,), (((evil,),),), evil)
    env = _environment()
    told = env.get_template("page.html").make_module(_empty()).table(it)
    assert "<script" not in told
    assert told.count("&lt;script&gt;") == 5
    told = env.get_template("page.md").make_module(_empty()).table(it)
    assert "\\|" in told
    assert "\\<script\\>" in told
    assert not re.search(r"(?<!\\)\]\(", told)


def _empty():
    nothing = PageTable("", (), ())
    one = dict.fromkeys(("asked", "metrics", "versions", "validation"), nothing)
    keys = ("differences", "months", "charts", "spaces", "groups", "melanopic", "verdicts",
            "judgements", "plan", "notes", "lights", "glare", "pictures")  # fmt: skip
    many = {key: [] for key in keys}
    digests = dict.fromkeys(("style", "script", "style_digest", "script_digest"), "")
    return {"t": labels(), "names": [], "drawn": {}, **one, **many, **digests}


def test_data_cannot_end_their_script():
    told = _environment().from_string("{{ it | tojson }}").render(it="</script>&'\u2028")
    assert json.loads(told) == "</script>&'\u2028"
    assert not set("<>&'\u2028") & set(told)


def test_text_is_short_and_without_characters_that_act():
    assert text("a\nb\x1b[2J\u202e" + "x" * 1000).isprintable()
    assert len(text("x" * 10_000)) < 400
    assert _inert('=HYPERLINK("x")') == '\'=HYPERLINK("x")'
    assert _inert("office") == "office"


def test_lines_break_where_a_month_has_no_hours():
    month = {"value": 1.0, "low": 0.0, "high": 2.0}
    values = [month] * 3 + [None] * 8 + [month]
    assert [[i for i, _ in run] for run in _runs(values)] == [[0, 1, 2], [11]]


def test_templates_and_script_use_words_of_the_table():
    every = labels()
    assert all(isinstance(word, str) and word for word in every.values())
    script = (TEMPLATES / "page.js").read_text()
    used = set(re.findall(r"\bt\.(\w+)", script + (TEMPLATES / "page.html").read_text()))
    assert used <= every.keys()
    for word in every.values():  # braces are names of values
        assert all(name.isidentifier() for _, name, _, _ in string.Formatter().parse(word) if name)


def test_the_sentence_on_what_decides_stands_in_the_table():
    assert {key: labels()[key] for key in WORDS} == WORDS


def test_the_validation_of_the_report_is_that_of_the_tests():
    table = (ROOT / "tests" / "validation" / "README.md").read_text("utf-8")
    rows = record.validation().rows
    assert len(rows) >= 5
    for row in rows:
        assert "| " + " | ".join(cell[0] for cell in row) + " |" in table


def test_metrics_of_the_months_are_those_of_the_charts():
    assert set(tables.MONTHLY) <= labels().keys()


def _space(name, storey=""):
    share = {"value": 50.0, "low": 49.0, "high": 51.0}
    row = {"name": name, "storey": storey, "floor_area": 20.0, "sensors": 80}
    return row | {"sDA": share, "ASE": share}


@pytest.mark.parametrize(("upper", "rows"), [("1", []), ("0", [("all spaces", "0")])])
def test_storeys_have_rows_where_one_has_several_spaces(upper, rows):
    """With a space on each, the rows repeated those of the spaces."""
    told = [_space("A", "0"), _space("B", upper)]
    storeys = [_space(storey) for storey in sorted({"0", upper})]
    numbers = {"spaces": told, "storeys": storeys, "building": _space("")}
    shown = spaces.table(SimpleNamespace(numbers=numbers), "house").rows
    names = [(row[0][0], row[2][0]) for row in shown]
    assert names[2:-1] == rows
    assert names[-1] == ("building, by floor area", "–")


def test_what_was_asked_has_transmittances_and_both_sides_of_a_wall():
    slab = SimpleNamespace(
        material=Lambertian(0.7, behind=(0.2, 0.3, 0.4)), names=("ceiling", "floor")
    )
    pane = SimpleNamespace(material=GlazingMaterial(type="glazing", transmittance=0.07))
    case = SimpleNamespace(
        room=None, building=SimpleNamespace(layers=[slab, pane]),
        materials={"glass": pane.material, "film": SimpleNamespace(type="bsdf")},
    )  # fmt: skip
    facade = SimpleNamespace(case=case)
    assert tables._reflectances(facade) == "ceiling 0.7, floor 0.2 / 0.3 / 0.4"
    assert tables._materials(facade) == "glass (glazing, transmittance 0.07), film (bsdf)"


def test_groups_that_follow_a_schedule_are_named_beside_the_rule_of_the_others():
    groups = GroupStates(("south", "east"), (("open", "cloth"), ("open", "cloth")))
    attributes = {"has_shade": 1, "shade_threshold": 1000.0, "shade_area": 0.02}
    attributes |= groups.attributes()
    closed = np.ones(8760, int)
    words = "closes where 1000 lx of direct sun reach 2 % of the points"
    for given, told in (
        ({}, words),
        ({0: closed}, f"{words}; south: follows a schedule"),
        ({0: closed, 1: closed}, "follows a schedule"),
    ):
        E = xr.Dataset(attrs=attributes | Schedule(given, 2).attributes())
        assert tables._shading(SimpleNamespace(illuminance=E)) == told
