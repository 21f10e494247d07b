"""Files that the readers take, valid and damaged: a result, or one line that says what is wrong."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings

from drcmitsuba import InputError
from drcmitsuba.metrics import stored_arrays
from tests import ROOT, skips
from tests.fast import slowly
from tests.hard import generated_files, generated_models
from tests.hard import generated_results as results
from tests.hard.command_line import GIB, growth_of, no_more_than
from tests.hard.fuzz_readers import patched
from tests.hard.generated_cases import STRANGE, TINY, furnish, toml, xml
from tests.hard.mutations import FUZZING
from tests.hard.readers import READERS, outcome, read_bsdf

STRATEGIES = {
    "wea": generated_files.weas(),
    "bsdf": generated_files.bsdf_files(),
    "pab_opto": generated_files.measurements(),
    "recipe": generated_files.recipes(),
    "obj": generated_files.meshes(),
    "time_stamps": generated_files.time_stamps(),
    "epw": generated_files.weather_years(".epw"),
    "tmy3": generated_files.weather_years(".csv"),
    "tmy2": generated_files.weather_years(".tm2"),
    **generated_models.MODELS,
}
SLOW = ("epw", "tmy3", "tmy2", "model_ifc")
"""Readers of 8760 rows, and one that starts a process."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of the file, beside what it may name."""
    folder = tmp_path_factory.mktemp("files")
    furnish(folder)
    generated_models.furnish(folder)
    return folder


def read_many(name, folder, tally, holds, examples):
    reader, growth = READERS[name][0], []

    @settings(max_examples=examples, **FUZZING)
    @given(STRATEGIES[name])
    def one(drawn):
        suffix, raw = drawn
        path = folder / f"made{suffix}"
        path.write_bytes(raw)
        with no_more_than(GIB):
            line, grown = growth_of(lambda: outcome(reader, path))
        tally["result" if line == "result" else "refused"] += 1
        growth.append(grown)

    one()
    holds(f"memory to read {name}, of 1 GiB", max(0, *growth) / GIB, 1)


@pytest.mark.parametrize("name", STRATEGIES)
def test_a_file_is_read_or_refused_in_one_line(name, folder, tally, holds):
    read_many(name, folder, tally, holds, 4 if name in SLOW else 12)


@pytest.mark.slow
@pytest.mark.parametrize("name", STRATEGIES)
def test_many_files_are_read_or_refused_in_one_line(name, folder, tally, holds):
    read_many(name, folder, tally, holds, 300 if name in SLOW else 3000)


# What is no plain file


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("kind", sorted({n.partition(".")[0] for n in STRANGE}))
def test_what_is_no_plain_file_is_refused_at_once(name, kind, folder):
    """A device never ends, a pipe never begins, a hole of 10 GiB is larger than the memory."""
    reader, suffix = READERS[name]
    with no_more_than(GIB):
        assert outcome(reader, folder / f"{kind}{suffix}") != "result"


@pytest.mark.parametrize("name", READERS)
def test_a_name_that_no_file_can_have_is_refused(name, folder):
    reader, suffix = READERS[name]
    for stem in ("x" * 5000, "\udcff", "a\nb\x1b[31m"):
        assert outcome(reader, folder / f"{stem}{suffix}") != "result"


# Results of one step that are the input of the next


@pytest.fixture(scope="module")
def good(tmp_path_factory, command):
    """Folder with the results of a tiny case."""
    folder = tmp_path_factory.mktemp("results")
    case = {
        "room": {"size": [4.0, 5.0, 3.0]},
        "materials": {
            "glass": {"type": "glazing", "transmittance": 0.65},
            "shade": {"type": "diffuser", "transmittance": 0.1},
        },
        "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.7, "material": "glass"}]}},
        "shading": {"material": "shade"},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [2, 2], "spacing": 0.6},
        "period": {"timestamps": "stamps.csv"},
        "accuracy": TINY,
    }
    (folder / "case.toml").write_text(toml(case))
    (folder / "stamps.csv").write_text("time\n2015-03-21T10:00\n2015-06-21T12:30\n")
    answer = command("evaluate", "case.toml", "-o", "good", folder=folder)
    assert answer.line == ""
    (folder / "plots").mkdir()
    (folder / "plots" / "illuminance.nc").write_bytes(
        (folder / "good" / "illuminance.nc").read_bytes()
    )
    for kind in ("illuminance", "metrics"):
        (folder / f"shown {kind}").mkdir()
        for name in ("illuminance.nc", "metrics.json", "plan.json"):
            shutil.copy(folder / "good" / name, folder / f"shown {kind}")
    return folder


def of_kind(kind, good):
    """The strategy draws a file of this kind, and the command takes it."""
    made, there = good / "made", good / "good"
    L, C = there / "sky.zarr", there / "coefficients.zarr"
    return {
        "coefficients": (results.zarrs(C, made), ("illuminance", made, L, "-o", "out")),
        "sky": (results.zarrs(L, made), ("illuminance", C, made, "-o", "out")),
        "illuminance": (
            results.netcdfs(there / "illuminance.nc", good / "e.nc"), ("metrics", "e.nc"),
        ),
        "metrics": (
            results.numbers(there / "metrics.json", good / "plots" / "metrics.json"),
            ("plot", "plots"),
        ),
        "shown illuminance": (
            results.netcdfs(there / "illuminance.nc", good / "shown illuminance/illuminance.nc"),
            ("report", "shown illuminance"),
        ),
        "shown metrics": (
            results.numbers(there / "metrics.json", good / "shown metrics/metrics.json"),
            ("report", "shown metrics"),
        ),
    }[kind]  # fmt: skip


KINDS = ("coefficients", "sky", "illuminance", "metrics", "shown illuminance", "shown metrics")


def use_many(kind, good, command, tally, holds, examples):
    strategy, arguments = of_kind(kind, good)
    growth = []

    @settings(max_examples=examples, **FUZZING)
    @given(strategy)
    def one(_):
        answer = command(*arguments, folder=good)
        tally["refused" if answer.line else "result"] += 1
        growth.append(answer.growth)

    one()
    holds(f"memory for {kind}, of 1 GiB", max(0, *growth) / GIB, 1)


@pytest.mark.parametrize("kind", slowly(KINDS, "metrics"))
def test_results_are_used_or_refused_in_one_line(kind, good, command, tally, holds):
    use_many(kind, good, command, tally, holds, 4)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_many_results_are_used_or_refused_in_one_line(
    kind, good, command, tally, holds
):  # fmt: skip
    use_many(kind, good, command, tally, holds, 1000)


# Failures that fuzzing brought up


def opened(path, *variables):
    return stored_arrays.loaded(path, stored_arrays.open_dataset(path, *variables))


def test_a_head_that_declares_terabytes_is_refused(good, tmp_path):
    """Chunks that are not there are filled with zeros: a few bytes stood for any amount."""
    for key in ("shape", "chunks"):
        path = tmp_path / key
        shutil.copytree(good / "good" / "sky.zarr", path)
        head = path / "L" / ".zarray"
        data = json.loads(head.read_text())
        data[key][-1] = 10**11
        head.write_text(json.dumps(data))
        if key == "shape":
            (path / "bin" / ".zarray").unlink()
        with no_more_than(GIB), pytest.raises(InputError, match=r"stands for|results"):
            opened(path, "L")


def test_a_damaged_hdf5_file_is_refused_once(good, command):
    """H5netcdf complained a second time, on stderr, when the half-open file was dropped."""
    raw = bytearray((good / "good" / "illuminance.nc").read_bytes())
    for at in range(48, 400, 16):
        changed = bytes([*raw[:at], raw[at] ^ 0xFF, *raw[at + 1 :]])
        (good / "e.nc").write_bytes(changed)
        assert len(command("metrics", "e.nc", folder=good).err.splitlines()) <= 1


def test_damaged_labels_are_refused(good, tmp_path):
    """Labels are read when they are asked for, after the file was opened."""
    path = tmp_path / "sky.zarr"
    shutil.copytree(good / "good" / "sky.zarr", path)
    (path / "bin" / "0").write_bytes(b"\x02\x016\x00nonsense")
    with pytest.raises(InputError):
        opened(path, "L")


def test_half_a_blend_is_refused(good, tmp_path):
    path = tmp_path / "sky.zarr"
    shutil.copytree(good / "good" / "sky.zarr", path)
    shutil.rmtree(path / "blend_weight")
    with pytest.raises(InputError, match="blend"):
        opened(path, "L")


@pytest.mark.parametrize("changes", ["type", "shape of labels", "threshold"])
def test_numbers_of_another_kind_are_refused(changes, good, tmp_path):
    """L of int8 took no sun out of a patch; labels without their dim; 1e300 lx in float32."""
    path = tmp_path / "damaged.zarr"
    name = "coefficients.zarr" if changes == "threshold" else "sky.zarr"
    with xr.open_zarr(good / "good" / name, consolidated=False, chunks=None) as data:
        data = results.plain_labels(data.load())
    if changes == "type":
        data = data.assign(L=data["L"].astype("int8"))
    elif changes == "threshold":
        data.attrs["shade_threshold"] = 1e300
    else:
        data = data.rename(bin="lines").assign(bin=("other", np.array(["a", "b"], object)))
    data.drop_encoding().to_zarr(path, zarr_format=2, consolidated=True)
    with pytest.raises(InputError, match="results"):
        opened(path, "replicates" if changes == "threshold" else "L")


def test_pieces_replace_bytes_of_a_whole_file():
    assert patched(b"0123456789", b"\x02\x00\x00\x03\x02xy") == b"01xy56789"
    assert patched(b"0123", b"\x00\x00") == b"0123"


def test_a_bsdf_of_zeros_is_read(tmp_path):
    path = Path(tmp_path / "zero.xml")
    path.write_text(xml([("Transmission Front", "{0}")]))
    read_bsdf(path)


@pytest.mark.slow
def test_the_harness_of_atheris_runs(tmp_path):
    """Coverage-guided, for a few seconds; the optional extra `fuzz`."""
    skips.module("atheris")
    root = ROOT
    arguments = [
        sys.executable,
        "-m",
        "tests.hard.fuzz_readers",
        "time_stamps",
        "-max_total_time=3",
    ]
    done = subprocess.run(arguments, cwd=root, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "time_stamps: {" in done.stdout
