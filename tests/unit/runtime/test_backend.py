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
    assert f"LLVM {version}" in line
    assert "17 or newer" in line
    assert "install LLVM 19" in line


def test_a_missing_llvm_gives_one_line(tmp_path):
    nowhere = str(tmp_path / "libLLVM.so")
    line = refused_in_one_line(
        doctor(DRJIT_LIBLLVM_PATH=nowhere, DRCMITSUBA_VARIANT="llvm_ad_mono")
    )
    assert f"no LLVM found that is fit: {nowhere} does not exist; run pip install" in line
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
    monkeypatch.setattr(backend, "DRIVER", Path("/nowhere"))
    with pytest.raises(BackendError, match="'cuda_ad_mono' needs a CUDA GPU and none was found"):
        backend.select("cuda_ad_mono")


OLD = "your version of CUDA is too old (found 11.4, at least 12.2 / driver R535 is required)"


@pytest.mark.parametrize("heard", [[], [f"jit_cuda_init(): {OLD} -- disabling CUDA backend!"]])
def test_a_driver_that_does_not_fit_is_told_with_the_remedy(monkeypatch, tmp_path, heard):
    monkeypatch.setattr(backend, "cuda_available", lambda: False)
    monkeypatch.setattr(backend, "DRIVER", tmp_path)
    monkeypatch.setattr(backend, "heard", heard)
    why = OLD if heard else "Dr.Jit does not take its driver"
    assert backend.report()["GPU (CUDA)"].startswith(f"not used: {why}")
    with pytest.raises(BackendError, match=r"driver does not fit: .*install NVIDIA's driver"):
        backend.select("cuda_ad_mono")


def test_a_gpu_that_cannot_trace_rays_is_left_for_the_processor(monkeypatch):
    """Without OptiX Dr.Jit finds a GPU, and Mitsuba fails with the first scene."""
    variants = []

    def load(scene):
        raise RuntimeError("jit_optix_api_init(): libnvoptix.so.1 could not be loaded")

    monkeypatch.delenv("DRCMITSUBA_VARIANT", raising=False)
    monkeypatch.setattr(backend, "cuda_available", lambda: True)
    monkeypatch.setattr(backend, "check_llvm", lambda: None)
    monkeypatch.setattr(mi, "variant", lambda: variants[-1] if variants else None)
    monkeypatch.setattr(mi, "set_variant", variants.append)
    monkeypatch.setattr(mi, "load_dict", load)
    backend.ray_tracing_fault.cache_clear()
    try:
        assert backend.select() == "llvm_ad_mono"
        with pytest.raises(BackendError, match=r"driver does not fit: .*libnvoptix.*570"):
            backend.select("cuda_ad_mono")
    finally:
        backend.ray_tracing_fault.cache_clear()
    assert variants == ["cuda_ad_mono", "llvm_ad_mono", "cuda_ad_mono"]


def test_a_library_that_cannot_be_loaded_is_told_with_the_reason(tmp_path):
    """It is of this processor by its head, and has nothing else."""
    head = Path(sys.executable).resolve().read_bytes()[:64]
    (tmp_path / "libLLVM.so.19.1").write_bytes(head)
    line = refused_in_one_line(
        doctor(
            DRJIT_LIBLLVM_PATH=str(tmp_path / "libLLVM.so.19.1"), DRCMITSUBA_VARIANT="llvm_ad_mono"
        )
    )
    assert "no LLVM found that can be loaded: " in line
    assert str(tmp_path) in line


def test_dr_jit_that_was_imported_first_has_not_heard_of_the_library():
    done = subprocess.run(
        [sys.executable, "-c", LATE], capture_output=True, text=True, check=True,
        env={k: v for k, v in os.environ.items() if k != "DRJIT_LIBLLVM_PATH"},
    )  # fmt: skip
    assert done.stdout.startswith("no LLVM found by Dr.Jit: import drcmitsuba before mitsuba")


LATE = """
import mitsuba
from pathlib import Path
from drcmitsuba.runtime import backend, llvm_library
llvm_library.Library.fault = ""
library = llvm_library.Library(Path("libLLVM.so"), "of the system")
llvm_library.find = lambda: llvm_library.LibraryChoice(library)
backend.llvm_version = lambda: None
try:
    backend.check_llvm()
except backend.BackendError as error:
    print(error)
"""


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
    assert report["LLVM from"] == "the search of Dr.Jit" or ", " in report["LLVM from"]
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
    assert len(pydoc.render_doc(drcmitsuba).splitlines()) <= 60


def test_selecting_a_variant_leaves_the_log_level_alone():
    """A warning of lost flux must reach the user who calls a plugin."""
    before = mi.log_level()
    try:
        mi.set_log_level(mi.LogLevel.Info)
        backend.select()
        assert mi.log_level() == mi.LogLevel.Info
    finally:
        mi.set_log_level(before)
