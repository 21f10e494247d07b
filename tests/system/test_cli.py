"""The command line with a user who makes mistakes: exit codes, one line, nothing half-written."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pvlib
import pytest

import drcmitsuba
from drcmitsuba.case.case import Case
from drcmitsuba.cli import main
from drcmitsuba.metrics import stored_arrays
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import BackendError
from tests.made_weather import clear_year, ten_minutes
from tests.system.small_room import RESULTS

TMY3 = Path(pvlib.__file__).parent / "data" / "723170TYA.CSV"
CASE = """
name = "small room"
[period]
months = [3]
[room]
size = [4.0, 5.0, 3.0]
[facade.south]
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.shade]
type = "diffuser"
transmittance = 0.1
[[furniture]]
name = "desk"
corner = [1.0, 1.0, 0.0]
size = [1.2, 0.6, 0.7]
[sensors]
corner = [0.5, 0.5, 0.8]
count = [3, 3]
spacing = 0.6
[shading]
material = "shade"
[accuracy]
replicates = 4
paths = 16
cell_size = 0.6
"""


@pytest.fixture
def case(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(CASE)
    return file


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    (folder / "case.toml").write_text(CASE)
    drcmitsuba.evaluate(drcmitsuba.load_case(folder / "case.toml")).save(folder / "r")
    return folder / "r"


# ---- mistakes ---------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", ["evaluate", "sky", "coefficients"])
def test_a_missing_case_is_refused(refused, tmp_path, verb):
    missing = tmp_path / "none.toml"
    line = refused(verb, missing, "-o", tmp_path / "r")
    assert line == f"{missing}: case file: no such file; give a case or a building"
    assert not (tmp_path / "r").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[furniture]", "[furnitrue]", 'furnitrue: unknown key; did you mean "furniture"?'),
        ("transmittance = 0.65", "transmitance = 0.65", "unknown key; did you mean"),
        ("[facade.south]", "frame = 0.1\n[facade.south]", "room.frame: unknown key; remove it"),
        ("0.65", "1.65", "materials.glass.transmittance: got 1.65; input should be less than or"),
        ("count = [3, 3]", "count = [7, 3]", "sensors: sensor 6 at (4.4, 0.8, 0.8) lies in, on or"),
        ("months = [3]", "hours = [9, 9]", "period.hours: (9, 9); give two"),
        ("months = [3]", 'timestamps = "none.csv"', "none.csv: file: no such file; give the path"),
        ("[period]", "[period", "TOML: Expected ']'"),
    ],
)
@pytest.mark.parametrize("verb", ["evaluate", "coefficients"])
def test_a_wrong_case_gives_one_line(refused, case, tmp_path, old, new, message, verb):
    assert CASE.count(old) == 1
    case.write_text(CASE.replace(old, new))
    line = refused(verb, case, "-o", tmp_path / "r")
    assert message in line
    assert line.startswith(str(tmp_path))
    assert not (tmp_path / "r").exists()


def cut(text):
    return "\n".join(text.splitlines()[:3000])


def cut_within_a_row(text):
    return text[: len(text) // 2]


def with_code(code):
    def write(text):
        rows = text.splitlines()
        names = rows[1].split(",")
        row = rows[100].split(",")
        row[names.index("DNI (W/m^2)")] = code
        rows[100] = ",".join(row)
        return "\n".join(rows)

    return write


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (cut, "rows: 2998 hours, last 05-05 21:00; give all 8760"),
        (cut_within_a_row, "the file is cut or damaged"),
        (with_code("9999"), "line 101, dni: '9999', the code for missing (rows like it: 1)"),
        (with_code("-9900"), "line 101, dni: '-9900', the code for missing"),
        (with_code("-5"), "line 101, dni: '-5', negative"),
        (with_code("lots"), "line 101, dni: 'lots', not a number"),
        (lambda text: "", "file: empty; give the text file as its publisher made it"),
        (lambda text: "\0" + text, "file: binary data (zero bytes)"),
    ],
    ids=["cut", "cut row", "9999", "-9900", "negative", "text", "empty", "binary"],
)
def test_unfit_weather_gives_one_line(refused, case, tmp_path, damage, message):
    file = tmp_path / "town.csv"
    file.write_text(damage(TMY3.read_text()))
    line = refused("evaluate", case, "--weather", file, "-o", tmp_path / "r")
    assert message in line
    assert line.startswith(f"{file}: ")
    assert not (tmp_path / "r").exists()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.epw", "none.epw: file: no such file; give the path of a file"),
        ("case.toml", "case.toml: suffix: '.toml'; use one of .epw, .csv, .tm2, .wea"),
        ("", "suffix: ''; use one of"),
    ],
)
def test_what_is_no_weather_file_is_refused(refused, case, tmp_path, name, message):
    line = refused("sky", case, "--weather", tmp_path / name, "-o", tmp_path / "r")
    assert message in line


@pytest.mark.parametrize("verb", ["evaluate", "sky", "coefficients"])
def test_results_cannot_go_into_a_file(refused, case, verb):
    line = refused(verb, case, "-o", case)
    assert line == f"{case}: -o: {case} is a file; name a folder"
    assert refused(verb, case, "-o", case / "r").startswith(f"{case / 'r'}: -o: {case} is a file")
    assert case.read_text() == CASE


def test_an_unwritable_folder_is_refused_before_the_work(refused, case, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write anywhere
    monkeypatch.setattr("drcmitsuba.evaluate", pytest.fail)
    line = refused("evaluate", case, "-o", tmp_path / "r")
    assert line == f"{tmp_path / 'r'}: -o: {tmp_path} may not be written; name another folder"


def test_a_full_disk_gives_one_line(refused, case, tmp_path, monkeypatch):
    def full(image, file):
        file.write_bytes(b"half")
        raise OSError(28, "No space left on device", str(file))

    monkeypatch.setattr("drcmitsuba.report.style.write", full)
    folder = tmp_path / "r"
    assert "No space left on device" in refused("evaluate", case, "-o", folder)
    left = {p.name for p in folder.iterdir()}
    assert left == {"illuminance.nc", "coefficients.zarr", "sky.zarr", "unfinished"}
    stored_arrays.open_dataset(folder / "illuminance.nc", "total").load()
    stored_arrays.open_dataset(folder / "coefficients.zarr", "replicates").load()


def test_a_disk_that_fills_up_beside_the_pictures_gives_one_line(
    refused, case, tmp_path, monkeypatch
):
    def full(parts, folder, along):
        folder.mkdir()
        (folder / "half").write_bytes(b"")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("drcmitsuba.runtime.zarr_folder.write", full)
    line = refused("evaluate", case, "-o", tmp_path / "r")
    assert line.startswith(f"{tmp_path / 'r'}: file: No space left on device; ")
    left = {p.name for p in (tmp_path / "r").iterdir()}
    assert "illuminance.nc" in left
    data = {name for name in left if not name.endswith(".png")}
    assert data == {"illuminance.nc", "unfinished"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evalute"], "command line: No such command 'evalute'"),
        (["evaluate"], "command line: Missing argument"),
        (["evaluate", "a", "b"], "command line: Got unexpected extra argument"),
        (["evaluate", "--wether", "x"], "command line: No such option: --wether"),
        (["evaluate", "classroom/exsting"], "did you mean the shipped case classroom/existing?"),
        (["plot", "nowhere", "--point", "1"], "--point: '1'; give --point x,y or x,y,z in metres"),
        (["plot", "nowhere", "--section", "1,2,3,nan"], "give --section X,Y,X,Y in metres"),
        (["plot", "nowhere", "--section", "1,2,1,2"], "--section: 1,2,1,2, a point; give two ends"),
        (["plot", "nowhere"], "illuminance.nc: results: no such file or folder; run the step"),
        (["metrics", "nowhere.nc"], "nowhere.nc: results: no such file or folder"),
        (["illuminance", "nowhere", "nowhere"], "nowhere: results: no such file or folder"),
    ],
)
def test_a_wrong_command_gives_one_line(refused, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in refused(*arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--sda-fraction", "7", "sda_fraction: got 7.0; did you mean 0.07?"),
        ("--sda-threshold", "-1", "sda_threshold: got -1.0; input should be greater than 0"),
        ("--ase-hours", "nan", "ase_hours: got NaN; input should be a finite number"),
        ("--ase-threshold", "much", "Invalid value for '--ase-threshold'"),
    ],
)
def test_unfit_thresholds_are_refused(refused, results, option, value, message):
    line = refused("metrics", results / "illuminance.nc", option, value)
    assert line.startswith("command line: ")
    assert message in line


def test_files_of_another_kind_are_refused(refused, results, tmp_path):
    E, C, L = (results / name for name in ("illuminance.nc", "coefficients.zarr", "sky.zarr"))
    assert "sky.zarr: results: has no 'replicates'" in refused("illuminance", L, C)
    assert "coefficients.zarr: results: has no 'L'" in refused("illuminance", C, C)
    assert "sky.zarr: results: has no 'total'" in refused("metrics", L)
    assert "metrics.json: results: " in refused("metrics", results / "metrics.json")
    storage.save_netcdf(stored_arrays.open_dataset(E).load(), tmp_path / "illuminance.nc")
    assert "metrics.json: metrics: " in refused("plot", tmp_path)
    (tmp_path / "metrics.json").write_text('{"settings": {"sensors": 3}}')
    assert "metrics.json: " in refused("plot", tmp_path)


def test_an_unfit_backend_is_exit_code_1(run, case, tmp_path, monkeypatch):
    def refuse():
        raise BackendError("LLVM 15.0.7 is unfit; install LLVM 19")

    monkeypatch.setattr("drcmitsuba.runtime.backend.check_llvm", refuse)
    monkeypatch.setenv("DRCMITSUBA_VARIANT", "llvm_ad_mono")
    for command in (["doctor"], ["evaluate", case, "-o", tmp_path / "r"]):
        code, _, err = run(*command)
        assert (code, err) == (1, "drcmitsuba: LLVM 15.0.7 is unfit; install LLVM 19\n")
    assert not (tmp_path / "r").exists()


def test_an_error_of_the_program_does_not_pass_for_bad_input(run, case, tmp_path, monkeypatch):
    def fail(case):
        raise ZeroDivisionError

    monkeypatch.setattr("drcmitsuba.annual.result.daylight_and_year", fail)
    with pytest.raises(ZeroDivisionError):
        run("evaluate", case, "-o", tmp_path / "r")


# ---- what works -------------------------------------------------------------------------------


def test_a_run_from_the_shell_says_its_numbers_and_nothing_else(case, tmp_path):
    command = [sys.executable, "-W", "error", "-m", "drcmitsuba.cli", "evaluate", "case.toml"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "sDA" in done.stdout
    assert "note: no weather file" in done.stdout
    assert re.search(r"results are in results, [\d.]+ [KM]iB\n$", done.stdout)
    assert {p.name for p in (tmp_path / "results").iterdir()} == RESULTS


def test_results_are_written_over_older_ones(run, case, tmp_path, results):
    for _ in range(2):
        code, _, err = run("evaluate", case, "-o", tmp_path / "new" / "r")
        assert (code, err) == (0, "")
    assert {p.name for p in (tmp_path / "new" / "r").iterdir()} == RESULTS


@pytest.mark.parametrize(
    ("make", "note"),
    [
        (lambda to: clear_year(to / "a.epw", 49.5, 8.6, 1.0, comment="fünf Jahre"), ""),
        (lambda to: clear_year(to / "a.epw", 34.2, -118.5, -8.0, leap=True),
         "29 February dropped (24 rows)"),
        (lambda to: ten_minutes(to / "a.wea", 37.62, -122.4, -8.0), ""),
    ],
    ids=["Latin-1 and no illuminances", "8784 rows", "ten minutes"],
)  # fmt: skip
def test_weather_files_with_quirks_are_fine(run, case, tmp_path, make, note):
    file = make(tmp_path)
    case.write_text(CASE.replace("months = [3]", "months = [3]\nhours = [11, 13]"))
    code, out, err = run("evaluate", case, "--weather", file, "-o", tmp_path / "r")
    assert (code, err) == (0, "")
    assert note in out
    numbers = json.loads((tmp_path / "r" / "metrics.json").read_text(encoding="utf-8"))
    assert numbers["settings"]["weather_source"] == str(file)
    assert numbers["msDA"][2] is not None


def test_plots_are_drawn_again(run, results):
    pictures = {name for name in RESULTS if name.endswith(".png")}
    for name in pictures:
        (results / name).unlink()
    code, out, err = run("plot", results, "--point", "0.7,0.8", "--point", "0.8,0.7")
    assert (code, err) == (0, "")
    pictures |= {
        f"{name}.png" for name in ("illuminance_mountain", "illuminance_section", "sun_path",
                                   "illuminance_year", "illuminance_year_0")
    }  # fmt: skip
    assert {Path(line).name for line in out.split()} == pictures
    assert all((results / name).read_bytes().startswith(b"\x89PNG") for name in pictures)


def test_the_schema_is_printed_as_json(run):
    code, out, err = run("schema")
    assert (code, err) == (0, "")
    assert json.loads(out) == Case.model_json_schema()


def test_the_doctor_reports_and_says_ready(run):
    code, out, err = run("doctor")
    assert (code, err) == (0, "")
    assert "LLVM" in out
    assert "mitsuba" in out
    assert "ready: " in out
    assert "× rays" in out.splitlines()[-1]


@pytest.mark.parametrize("verb", sorted(main.VERBS))
def test_every_verb_has_a_help_page(run, verb):
    code, out, err = run(verb, "--help")
    assert (code, err) == (0, "")
    assert "Usage" in out
    assert "<" not in out.replace("(θ < 90°)", "")  # Python's types
