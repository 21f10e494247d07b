"""A machine that cannot run the program gets one line that says so, before any kernel is made."""

import os
import pydoc
import re
import subprocess
import sys
from pathlib import Path

import mitsuba as mi
import pytest

import drcmitsuba
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import BackendError
from tests import skips

UNFIT = [14, 15, 16]
DOCTOR = [sys.executable, "-W", "error", "-m", "drcmitsuba.cli", "doctor"]


def libraries(version):
    """LLVM libraries of a version on this machine."""
    places = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/opt/homebrew/opt")
    names = (f"libLLVM-{version}.so*", f"libLLVM.so.{version}*")
    return [f for p in places for n in names for f in sorted(Path(p).glob(f"*/{n}"))] + [
        f for p in places for f in sorted(Path(p).glob(f"llvm*{version}/lib/libLLVM*"))
    ]


def doctor(**variables):
    return subprocess.run(
        DOCTOR, env=os.environ | variables, capture_output=True, text=True, timeout=60, check=False
    )


def refused_in_one_line(done):
    """Message of a run that ended well-behaved: exit code 1 and one line on stderr."""
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("drcmitsuba: ")
    return lines[0]


@pytest.mark.parametrize("version", UNFIT)
def test_an_unfit_llvm_is_refused_in_one_line_without_an_abort(version):
    paths = libraries(version)
    if not paths:
        skips.UNFIT_LLVM.skip(version)
    line = refused_in_one_line(
        doctor(DRJIT_LIBLLVM_PATH=str(paths[0]), DRCMITSUBA_VARIANT="llvm_ad_mono")
    )
    assert "older than 15" in line if version < 15 else f"LLVM {version}." in line
    assert "install LLVM 19" in line


def test_a_missing_llvm_gives_one_line(tmp_path):
    nowhere = str(tmp_path / "libLLVM.so")
    line = refused_in_one_line(
        doctor(DRJIT_LIBLLVM_PATH=nowhere, DRCMITSUBA_VARIANT="llvm_ad_mono")
    )
    assert "no LLVM found" in line
    assert "install LLVM 19" in line


@pytest.mark.parametrize("version", [(14, 0, 6), (15, 0, 7), (16, 0, 0)])
def test_versions_below_17_are_refused(monkeypatch, version):
    monkeypatch.setattr(backend, "llvm_version", lambda: version)
    with pytest.raises(BackendError, match=rf"LLVM {version[0]}\..* is unfit, 17 or newer"):
        backend.select("llvm_ad_mono")


@pytest.mark.parametrize("version", [(17, 0, 1), (19, 1, 7), (22, 0, 0)])
def test_versions_from_17_are_taken(monkeypatch, version):
    monkeypatch.setattr(backend, "llvm_version", lambda: version)
    backend.check_llvm()


def test_no_llvm_is_refused(monkeypatch):
    monkeypatch.setattr(backend, "llvm_version", lambda: None)
    with pytest.raises(BackendError, match=r"no LLVM found.*DRJIT_LIBLLVM_PATH"):
        backend.select("llvm_ad_mono")


@pytest.mark.parametrize("name", ["llvm_ad_momo", "scalar_rgb", ""])
def test_a_variant_that_cannot_be_run_is_refused(monkeypatch, name):
    monkeypatch.setenv("DRCMITSUBA_VARIANT", name)
    if not name:  # as good as not set
        assert backend.select() in mi.variants()
        return
    with pytest.raises(BackendError, match=f"variant '{name}' is none of .*llvm_ad_mono"):
        backend.select()


def test_a_gpu_variant_needs_a_gpu(monkeypatch):
    monkeypatch.setattr(backend, "cuda_available", lambda: False)
    with pytest.raises(BackendError, match="'cuda_ad_mono' needs a CUDA GPU and none was found"):
        backend.select("cuda_ad_mono")


def test_the_user_variant_is_kept_unless_it_is_scalar(monkeypatch):
    monkeypatch.delenv("DRCMITSUBA_VARIANT", raising=False)
    before = backend.select()
    fit = "cuda_ad_mono" if backend.cuda_available() else "llvm_ad_mono"
    try:
        mi.set_variant("scalar_rgb")
        assert backend.select() == mi.variant() == fit
        other = fit.replace("mono", "rgb")
        mi.set_variant(other)
        assert backend.select() == mi.variant() == other
        monkeypatch.setenv("DRCMITSUBA_VARIANT", fit)
        assert backend.select() == mi.variant() == fit
    finally:
        backend.select(before)


def test_importing_sets_no_variant_and_says_nothing():
    code = "import drcmitsuba, mitsuba; print(mitsuba.variant())"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "None"
    assert done.stderr == ""


def test_the_report_names_backends_and_versions():
    report = backend.report()
    assert re.fullmatch(r"\d+\.\d+\.\d+|not found", report["LLVM"])
    assert report["GPU (CUDA)"] in ("found", "not found")
    assert int(report["threads"]) >= 1
    assert report["mitsuba"] == mi.__version__


def test_plugins_are_registered_however_mitsuba_is_imported():
    rgb = backend.select().replace("mono", "rgb")
    for first, second in (("drcmitsuba", "mitsuba"), ("mitsuba", "drcmitsuba")):
        code = f"import {first}, {second}, mitsuba as mi; mi.set_variant('{rgb}'); "
        code += "print(mi.load_dict({'type': 'tregenza_sky'}))"
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True
        )
        assert done.stdout.startswith("TregenzaSky")


def test_rooms_and_their_modules_resolve_after_one_import():
    code = "import drcmitsuba as d, sys; assert 'mitsuba' not in sys.modules; "
    code += "print(callable(d.bsdf.check.check), callable(d.goniophotometer.measure), "
    code += "callable(d.design.optimise.optimise), callable(d.evaluate), hasattr(d, 'nonsense'))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True", "True", "True", "False"]


def test_help_of_the_package_fits_on_a_screen():
    assert len(pydoc.render_doc(drcmitsuba).splitlines()) < 60


def test_selecting_a_variant_leaves_the_log_level_alone():
    """A warning of lost flux must reach the user who calls a plugin."""
    before = mi.log_level()
    try:
        mi.set_log_level(mi.LogLevel.Info)
        backend.select()
        assert mi.log_level() == mi.LogLevel.Info
    finally:
        mi.set_log_level(before)
