"""The command line beside its results: help, version, a first case, stops, full disks."""

import os
import signal
import subprocess
import sys

import pytest

import drcmitsuba
from tests import skips
from tests.system.conftest import imports_mitsuba, is_ready
from tests.system.small_room import SITE
from tests.system.test_cli import CASE

COMMAND = [sys.executable, "-W", "error", "-m", "drcmitsuba"]


@pytest.fixture
def case(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(CASE)
    return file


@pytest.fixture(scope="module")
def illuminance(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    (folder / "case.toml").write_text(CASE)
    drcmitsuba.evaluate(folder / "case.toml").save(folder)
    return folder / "illuminance.nc"


def test_the_bare_command_shows_its_verbs(run):
    code, out, err = run()
    assert (code, err) == (0, "")
    for verb in ("new", "evaluate", "plan", "doctor"):
        assert f"\n  {verb} " in out


def test_the_version(run):
    assert run("--version") == (0, f"drcmitsuba {drcmitsuba.__version__}\n", "")


def test_square_brackets_stay_in_the_help(run):
    assert "a table [design]" in run("optimise", "--help")[1]
    assert "[lx]" in run("metrics", "--help")[1]
    assert "[deg]" in run("bsdf", "--help")[1]


def test_a_new_case_is_written_once_and_evaluates(run, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run("new")
    assert (code, err) == (0, "")
    assert "drcmitsuba evaluate case.toml" in out
    text = (tmp_path / "case.toml").read_text(encoding="utf-8")
    assert "nothing is overwritten" in refused("new", "case.toml")
    assert (tmp_path / "case.toml").read_text(encoding="utf-8") == text
    assert "no name of a TOML file" in refused("new", "case.json")
    short = text.replace("[period]\n", "[period]\nmonths = [3]\ndays_per_week = 1\n")
    (tmp_path / "case.toml").write_text(short, encoding="utf-8")
    code, out, err = run("evaluate", "case.toml")
    assert (code, err) == (0, "")
    assert "my room" in out


@pytest.mark.parametrize(
    ("verb", "more"),
    [
        ("sky", []),
        ("coefficients", []),
        ("lights", ["--point", "2,2"]),
        ("comply", ["--standard", "lm-83-12"]),
        ("study", []),
        ("export", ["--radiance", "radiance"]),
    ],
)
def test_every_verb_says_whose_weather_it_takes(run, tmp_path, monkeypatch, verb, more):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "case.toml").write_text(CASE + SITE)
    (tmp_path / "study.toml").write_text('case = "case.toml"\n[columns]\n"name" = ["a", "b"]\n')
    source = "study.toml" if verb == "study" else "case.toml"
    code, out, err = run(verb, source, *more)
    assert (code, err) == (0, "")
    notes = [line for line in out.splitlines() if line.startswith("note: no weather file")]
    assert len(notes) == 1
    assert "not [site]" in notes[0]


@pytest.mark.parametrize("verb", ["evaluate", "sky", "plan"])
@pytest.mark.parametrize(("name", "line"), [("", "the name is empty"), ("x.csv", "a .csv file")])
def test_results_want_the_name_of_a_folder(refused, case, tmp_path, monkeypatch, verb, name, line):
    monkeypatch.chdir(tmp_path)
    assert line in refused(verb, case, "-o", name)
    assert [file.name for file in tmp_path.iterdir()] == ["case.toml"]


@pytest.mark.parametrize(
    ("name", "line"),
    [
        (
            "room.oct",
            "a compiled Radiance scene; give a case (TOML), as `drcmitsuba new` writes it",
        ),
        ("town.epw", "a weather file; give a case (TOML)"),
        ("letter.xml", "no building in gbXML; give a case (TOML)"),
    ],
)
def test_a_file_of_another_program_is_named(refused, tmp_path, name, line):
    (tmp_path / name).write_text("void plastic grey 0 0 5 .5 .5 .5 0 0\n")
    assert refused("evaluate", tmp_path / name).startswith(f"{tmp_path / name}: case file: {line}")


def test_the_case_of_a_missing_weather_file_is_named(refused, case, tmp_path):
    case.write_text(CASE + '[weather]\nfile = "none.epw"\n')
    line = refused("sky", case, "-o", tmp_path / "r")
    assert line.startswith(f"{case}: weather.file: {tmp_path / 'none.epw'}: no such file; ")


def test_a_closed_pipe_is_no_error_and_the_file_is_written(illuminance, tmp_path):
    command = [*COMMAND, "metrics", illuminance, "-o", tmp_path / "m"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert (process.wait(timeout=120), err) == (0, b"")
    assert (tmp_path / "m" / "metrics.json").is_file()


@skips.POSIX.mark
def test_a_full_disk_is_one_line_and_no_crash(illuminance, tmp_path):
    """HDF5 ended the process by a segmentation fault after the line was written."""
    import resource

    results = illuminance.parent
    command = [*COMMAND, "illuminance", results / "coefficients.zarr", results / "sky.zarr"]
    limit = 10_000  # bytes that a file may have, but for the kernels of a GPU's driver
    done = subprocess.run(
        [*command, "-o", tmp_path / "f"], capture_output=True, text=True, check=False,
        env=os.environ | {"OPTIX_CACHE_MAXSIZE": "0"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith(f"drcmitsuba: {tmp_path / 'f'}: file: File too large; check")
    assert done.stderr.count("\n") == 1
    assert list((tmp_path / "f").iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("sign", [is_ready, imports_mitsuba])
def test_a_stop_at_the_start_is_one_line(stopped, case, tmp_path, number, sign):
    answer = stopped(number, sign, "evaluate", case, "-o", tmp_path / "r")
    assert answer == (130, "drcmitsuba: stopped\n")
    assert not (tmp_path / "r").exists()
