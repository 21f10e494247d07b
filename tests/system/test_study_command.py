"""A study evaluates many variations of a case once, tells wrong rows in its table, and goes on."""

import json
from importlib.util import find_spec

import numpy as np
import pandas as pd
import pytest

import drcmitsuba
from drcmitsuba import load_case
from drcmitsuba.annual.study import StudyTable, study
from drcmitsuba.blocks import block_folder
from drcmitsuba.blocks.stored_before import MOST_LINES, StoredBefore
from drcmitsuba.case.study import load_study
from drcmitsuba.report.study_charts import charts
from drcmitsuba.report.style import png
from drcmitsuba.runtime import provenance
from drcmitsuba.runtime.errors import InputError
from tests import skips
from tests.system.small_room import changed, run

TEXT = changed(
    ("count = [5, 5]", "count = [3, 3]"), ("months = [3, 6]", "months = [3]"),
    ("[accuracy]\nreplicates = 4", '[effects]\npictures = "off"\n[accuracy]\nreplicates = 2'),
)  # fmt: skip
GRID = """
case = "case.toml"
[grid]
"metrics.sda_threshold" = [200, 400]
"shading.threshold" = [300.0, 1000.0]
"facade.south.strips.0.material" = ["glass", "brass"]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "case.toml").write_text(TEXT)
    (tmp_path / "study.toml").write_text(GRID)
    return tmp_path


def written(folder, text):
    (folder / "study.toml").write_text('case = "case.toml"\n' + text)
    return load_study(folder / "study.toml")


def test_a_grid_traces_each_block_once_and_tells_wrong_rows(folder, monkeypatch, capsys):
    blocks, write_block = [], block_folder.write_block
    monkeypatch.setattr(
        block_folder, "write_block", lambda *a: write_block(*a) or blocks.append(a[1])
    )
    run(monkeypatch, "study", folder / "study.toml", "-o", folder / "out")
    assert len(blocks) == 2  # the open and the shaded state, for four rows
    out = " ".join(capsys.readouterr().out.split())
    assert "row 2: " in out
    assert 'unknown material "brass"' in out
    assert "4 of 8 rows have metrics" in out
    table = pd.read_csv(folder / "out" / "table.csv")
    if find_spec("pyarrow") is not None:
        packed = pd.read_parquet(folder / "out" / "table.parquet")
        packed = packed.replace({"error": {"": np.nan}})
        pd.testing.assert_frame_equal(packed, table, check_dtype=False)
    assert list(table["row"]) == [*range(1, 9)]
    assert list(table.columns[1:4]) == list(load_study(folder / "study.toml").grid)
    right = table[table["error"].isna()]
    assert list(right["row"]) == [1, 3, 5, 7]
    assert table["sDA"].isna().sum() == 4
    for name in ("sDA", "ASE", "shade_closed", "msDA_3", "MSE_3"):
        assert (right[f"{name}_low"] <= right[name]).all()
        assert (right[name] <= right[f"{name}_high"]).all()
    changes = [
        ("[shading]\n", "[shading]\nthreshold = 300.0\n"),
        ("[sensors]", "[metrics]\nsda_threshold = 400.0\n[sensors]"),
    ]
    text = TEXT
    for old, new in changes:
        text = text.replace(old, new)
    (folder / "alone.toml").write_text(text)
    alone = drcmitsuba.evaluate(load_case(folder / "alone.toml")).metrics
    of_table = right[right["row"] == 5].iloc[0]
    for name in ("sDA", "ASE", "shade_closed"):
        assert of_table[name] == pytest.approx(alone[name]["value"], rel=1e-5)
    assert {p.name for p in (folder / "out").glob("*.png")} == {"parallel.png", "scatter.png"}

    # The same study again only reads; a damaged row is evaluated anew.
    rows = sorted((folder / "out" / "rows").iterdir())
    assert len(rows) == 4
    rows[0].write_text('{"sDA":')
    evaluated, evaluate = [], drcmitsuba.annual.study.evaluate_within
    monkeypatch.setattr(
        "drcmitsuba.annual.study.evaluate_within",
        lambda case, **o: evaluated.append(case) or evaluate(case, **o),
    )
    before = (folder / "out" / "table.csv").read_text()
    run(monkeypatch, "study", folder / "study.toml", "-o", folder / "out")
    assert len(evaluated) == 1
    assert len(blocks) == 2
    assert (folder / "out" / "table.csv").read_text() == before


def test_a_study_that_was_stopped_goes_on(folder, monkeypatch):
    plan, evaluated = load_study(folder / "study.toml"), []
    evaluate = drcmitsuba.annual.study.evaluate_within

    def stopped(case, **options):
        if len(evaluated) == 2:
            raise KeyboardInterrupt
        evaluated.append(case)
        return evaluate(case, **options)

    with monkeypatch.context() as patched:
        patched.setattr("drcmitsuba.annual.study.evaluate_within", stopped)
        with pytest.raises(KeyboardInterrupt):
            study(plan, folder / "out", folder / "cache")
    assert not (folder / "out" / "table.csv").exists()
    assert len([*(folder / "out" / "rows").iterdir()]) == 2
    table = study(plan, folder / "out", folder / "cache")
    assert table.frame["sDA"].notna().sum() == 4
    assert "sDA" in table._repr_html_()


def test_a_study_of_wrong_rows_alone_ends_with_2(folder, monkeypatch, capsys):
    written(folder, '[columns]\n"accuracy.replicates" = ["x", "y"]\n')
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, "study", folder / "study.toml", "-o", folder / "out")
    assert stop.value.code == 2
    assert "0 of 2 rows have metrics" in capsys.readouterr().out


def test_rows_come_from_columns_and_from_csv(folder):
    rows = written(
        folder, "[columns]\n'metrics.sda_threshold' = [200, 300]\n'name' = ['a', 'b']"
    ).each()
    assert rows == [
        {"metrics.sda_threshold": 200, "name": "a"}, {"metrics.sda_threshold": 300, "name": "b"},
    ]  # fmt: skip
    (folder / "rows.csv").write_text("name\n007\n")
    assert written(folder, 'rows = "rows.csv"').each() == [{"name": "007"}]
    (folder / "rows.csv").write_text("metrics.sda_threshold,sensors.count.0,name\n200,2,x\n,3,\n")
    plan = written(folder, 'rows = "rows.csv"')
    assert plan.each() == [
        {"metrics.sda_threshold": 200, "sensors.count.0": 2, "name": "x"}, {"sensors.count.0": 3},
    ]  # fmt: skip
    case = plan.case_of(plan.each()[0])
    assert (case.metrics.sda_threshold, case.sensors.count, case.name) == (200, (2, 3), "x")
    assert plan.case_of(plan.each()[1]).name == "small room"


def test_a_sample_fills_its_bounds_evenly(folder):
    bounds = "'room.floor' = [0.1, 0.4]\n'room.walls' = [0.3, 0.7]"
    text = f"[sample]\ncount = 64\n[sample.between]\n{bounds}"
    rows = written(folder, text).each()
    floor, walls = (np.array([row[key] for row in rows]) for key in ("room.floor", "room.walls"))
    # A Halton sequence has as many points in each eighth and each ninth, up to one or two.
    assert np.histogram(floor, 8, (0.1, 0.4))[0].tolist() == [8] * 8
    assert abs(np.histogram(walls, 9, (0.3, 0.7))[0] - 64 / 9).max() <= 1
    assert written(folder, text).each() == rows
    assert written(folder, text.replace("64", "64\nseed = 1")).each() != rows


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "grid, columns, rows, sample: none; give one"),
        ("[grid]\na = [1]\n[columns]\na = [1]", "grid, columns; give one"),
        ("[grid]\na = []", "0 rows"),
        ("[columns]\na = [1]\nb = [1, 2]", "equally many"),
        ('rows = "none.csv"', "no such file"),
        ('rows = "bad.csv"', "more or fewer fields"),
        ("[sample]\ncount = 2\nbetween = { a = [2, 1] }", "sample.between.a: 2 to 1; give rising"),
        ("[gird]\na = [1]", "unknown key"),
        ("[grid]\nrow = [1]", 'key: "row" is no key of a case'),
        ("[grid]\n'metrics..sda_threshold' = [1]", "give one as a.b.0.c"),
        ('rows = "twice.csv"', '2 columns "room.floor"; give each key one column'),
        (f"[grid]\na = {[*range(400)]}\nb = {[*range(400)]}", "160000 rows"),
    ],
)
def test_an_unfit_study_is_refused_in_a_line(folder, text, words):
    (folder / "bad.csv").write_text("a,b\n1\n")
    (folder / "twice.csv").write_text("room.floor,room.walls,room.floor\n0.2,0.5,0.3\n")
    with pytest.raises(InputError, match=words):
        study(written(folder, text), folder / "out")
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("nothing.there", "unknown key"),
        ("room.size.7", "no entry 7"),
        ("name.of", "a value where the key has a table"),
        ("materials.glass.transmittance", "transmittance"),
    ],
)
def test_a_wrong_key_or_value_is_told_in_the_table(folder, key, words):
    table = study(written(folder, f"[grid]\n'{key}' = [7.5]"), folder / "out").frame
    assert words in table["error"][0]
    assert np.isnan(table["sDA"][0])
    json.dumps(table["error"].tolist())


@pytest.mark.parametrize(
    "values", [["x", 2.5, None, True], [None] * 4, [1, 2.5, None, 3], ["a", "b", None, "c"]]
)
def test_columns_of_any_values_are_packed(tmp_path, values):
    skips.module("pyarrow")
    nothing = {name: [np.nan] * 4 for name in ("sDA", "ASE")}
    frame = pd.DataFrame({"row": range(1, 5), "a": pd.Series(values, dtype=object), **nothing})
    StudyTable(frame.assign(error="wrong"), ("a",)).save(tmp_path)
    packed = pd.read_parquet(tmp_path / "table.parquet")
    for value, read in zip(values, packed["a"], strict=True):
        assert pd.isna(read) if value is None else read in (value, str(value))
    assert (packed["error"] == "wrong").all()


def test_pictures_of_texts_numbers_and_single_values():
    rows = 5
    frame = pd.DataFrame({
        "row": range(1, rows + 1), "a": ["x", "y", "x", "$z$", "y"], "b": [1.0] * rows,
        "c": np.linspace(0, 1000, rows), **{m: np.linspace(10, 90, rows) for m in ("sDA", "ASE")},
        **{f"{m}_{e}": np.linspace(10, 90, rows) for m in ("sDA", "ASE") for e in ("low", "high")},
    })  # fmt: skip
    drawn = charts(frame, ["a", "b", "c"])
    labels = [text.get_text() for text in drawn["parallel.png"].axes[0].texts]
    assert {"x", "y", "$z$", "1", "0", "500", "1000", "10", "90"} <= set(labels)
    names = [text.get_text() for text in drawn["scatter.png"].axes[0].texts]
    assert names == ["1", "2", "3", "4", "5"]
    assert charts(frame.assign(sDA=np.nan), ["a"]) == {}
    formula = "materials.$\\foo{$"
    png(charts(frame.rename(columns={"a": formula}), [formula, "b"])["parallel.png"])


def test_a_study_says_from_which_rows_and_blocks_it_goes_on(folder, monkeypatch, capsys):
    """It went on from stored rows and blocks without a word."""
    run(monkeypatch, "study", folder / "study.toml", "-o", folder / "out")
    assert "going on" not in capsys.readouterr().err
    rows = sorted((folder / "out" / "rows").glob("*.json"))
    assert len(rows) == 4
    rows[0].unlink()
    run(monkeypatch, "study", folder / "study.toml", "-o", folder / "out")
    err = capsys.readouterr().err.splitlines()
    assert err[0] == f"going on from 3 of 8 rows stored in {folder / 'out' / 'rows'}"
    assert "open: going on from 1 of 1 blocks stored in " in err[1]
    assert all("going on from 1 of 1 blocks" in line for line in err[1:])


def test_rows_and_blocks_of_another_method_are_made_again(folder, monkeypatch, capsys):
    """The key of a row left out the method: rows kept the numbers of an older one."""
    command = "study", folder / "study.toml", "-o", folder / "out"
    run(monkeypatch, *command)
    rows = folder / "out" / "rows"
    before = {path.name for path in rows.glob("*.json")}
    capsys.readouterr()
    monkeypatch.setattr(provenance, "METHOD", provenance.METHOD + 1)
    run(monkeypatch, *command)
    err = capsys.readouterr().err.splitlines()
    assert err[0] == f"stored rows of another version, evaluated again: 4 in {rows}"
    assert "open: blocks in " in err[1]
    assert err[1].endswith("are of another version or variant, and made again")
    after = {path.name for path in rows.glob("*.json")} - before
    assert {name[:32] for name in after} == {name[:32] for name in before}
    assert len(after) == len(before)


def test_many_stored_blocks_have_few_lines(tmp_path):
    files, lines = [], []
    for number in range(15):
        (tmp_path / f"{number}").mkdir()
        files.append(tmp_path / f"{number}" / "0.zip")
        files[-1].write_text("")
    before = StoredBefore.of(tmp_path, lines.append)
    for file in files:
        before.tell_once("room, open", [file])
    assert len(lines) == MOST_LINES + 1
    assert lines[-1] == f"further blocks of {tmp_path} are used or made again without a line each"


def test_a_part_of_a_key_in_quotes_may_hold_dots(tmp_path):
    """As names of Honeybee's materials do."""
    name = "glass 0.65"
    (tmp_path / "case.toml").write_text(TEXT.replace('"glass"', f'"{name}"').replace(
        "materials.glass]", f'materials."{name}"]'
    ))  # fmt: skip
    keys = f"""case = "case.toml"\n[grid]\n'materials."{name}".transmittance' = [0.2, 0.4]\n"""
    (tmp_path / "study.toml").write_text(keys)
    plan = load_study(tmp_path / "study.toml")
    cases = [plan.case_of(row) for row in plan.each()]
    assert [case.materials[name].transmittance for case in cases] == [0.2, 0.4]
    assert set(cases[0].materials) == set(load_case(tmp_path / "case.toml").materials)
    with pytest.raises(InputError, match="no name"):
        plan.case_of({".": 1})


def test_an_empty_field_shows_the_value_of_the_case(folder, monkeypatch, capsys):
    """Lines of the picture go through it, and headings are as short as they differ."""
    (folder / "rows.csv").write_text(
        "materials.glass.transmittance,shading.threshold,room.floor\n0.5,,\n,500,\n"
    )
    (folder / "rows.toml").write_text('case = "case.toml"\nrows = "rows.csv"\n')
    plan = load_study(folder / "rows.toml")
    assert plan.stated("materials.glass.transmittance") == 0.65
    assert plan.stated("facade.south.strips.0.material") == "glass"
    assert plan.stated("shading.threshold") is plan.stated("..") is plan.stated("room.9") is None
    run(monkeypatch, "study", folder / "rows.toml", "-o", folder / "out")
    table = pd.read_csv(folder / "out" / "table.csv")
    assert table["materials.glass.transmittance"].tolist() == [0.5, 0.65]
    shown = capsys.readouterr().out
    assert "transmittance" in shown
    assert "materials.glass" not in shown
    assert "nan" not in shown


def test_semicolons_are_refused_in_one_line(folder):
    (folder / "rows.csv").write_text("room.floor;room.walls\n0.2;0.5\n")
    (folder / "rows.toml").write_text('case = "case.toml"\nrows = "rows.csv"\n')
    with pytest.raises(InputError, match=r"semicolons in .room"):
        load_study(folder / "rows.toml").each()
