"""The compiler backend that runs the kernels: LLVM on the processor, CUDA on a GPU.

A GPU is used where its driver is fit, else LLVM, whose library `llvm_library` finds. Dr.Jit refuses
old versions of both with messages of its own or a traceback, and LLVM 15 and 16 abort the whole
process. So the program checks them before any kernel runs, and refuses what is unfit in one line
that says what to install.
"""

from __future__ import annotations

import os
import platform
from functools import lru_cache
from importlib import metadata
from pathlib import Path

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.symbolic import rewriting_later

from drcmitsuba.runtime import kernel_folder, llvm_library
from drcmitsuba.runtime.errors import BackendError, on_a_line

REMEDY = (
    "run pip install 'drcmitsuba[llvm]', or install LLVM 19 (Debian, Ubuntu: apt-get install "
    "libllvm19; Fedora: dnf install llvm-libs; macOS: brew install llvm; Windows: winget install "
    f"LLVM.LLVM), or set {llvm_library.VARIABLE} to its library"
)
DRIVER_REMEDY = (
    "install NVIDIA's driver 570 or newer, or set DRCMITSUBA_VARIANT=llvm_ad_mono for the processor"
)
DRIVER = Path("/proc/driver/nvidia/version")
"""File of Linux that is there where the driver of a GPU of NVIDIA is loaded."""

heard: list[str] = []
"""Lines that Dr.Jit wrote while it was imported by a command, which shows none of them."""


def _said(of: str) -> str:
    """Return what Dr.Jit said of something while it was imported; empty where it said nothing."""
    line = next((line for line in heard if of in line), "")
    return on_a_line(line.partition("(): ")[2] or line).rstrip("!.")


def cuda_available() -> bool:
    """Whether Dr.Jit can use a GPU."""
    return bool(dr.has_backend(dr.JitBackend.CUDA))


def cuda_fault() -> str:
    """Why Dr.Jit uses no GPU though a driver is there; empty where it does, or there is none."""
    if cuda_available():
        return ""
    if said := _said("CUDA is too old") or _said("cuInit") or _said("cuda_api_init"):
        return said
    return "Dr.Jit does not take its driver, as it does 535 and newer" if DRIVER.exists() else ""


@lru_cache(maxsize=1)
def ray_tracing_fault() -> str:
    """Why Mitsuba cannot trace rays on the GPU whose variant is set; empty where it can.

    Rays need OptiX, a part of the driver that Dr.Jit loads with the first scene, and that some
    drivers lack in containers.
    """
    try:
        mi.load_dict({"type": "scene", "pane": {"type": "rectangle"}})
    except RuntimeError as error:
        return on_a_line(str(error))
    return ""


def llvm_version() -> tuple[int, ...] | None:
    """Version of the LLVM that Dr.Jit loads; None where there is no LLVM."""
    if not dr.has_backend(dr.JitBackend.LLVM):
        return None
    version = dr.detail.llvm_version()
    return tuple(int(v) for v in version) if version else None


def check_llvm() -> None:
    """Raise BackendError where LLVM is missing or older than 17."""
    version = llvm_version()
    if version is None:
        raise BackendError(f"no LLVM found{_why_no_llvm()}; {REMEDY}")
    if version[0] < llvm_library.OLDEST:
        number = ".".join(str(v) for v in version)
        needed = f"{llvm_library.OLDEST} or newer is needed"
        search, remedy = llvm_library.use(), REMEDY
        if search.is_late and search.chosen and not search.chosen.fault:
            remedy = f"import drcmitsuba before Dr.Jit to have {search.chosen.path} taken"
        raise BackendError(f"LLVM {number} is unfit, {needed}; {remedy}")


def _why_no_llvm() -> str:
    """Sentence on the libraries that were found and are not used."""
    search = llvm_library.use()
    if search.chosen is None or search.chosen.fault:
        return f" that is fit: {search.faults}" if search.unfit else ""
    if search.is_late:
        return f" by Dr.Jit: import drcmitsuba before mitsuba to have {search.chosen.path} taken"
    return f" that can be loaded: {_said('Unable to load') or search.chosen.path}"


def select(variant: str | None = None) -> str:
    """Set a Mitsuba variant that the program can run on.

    Parameters
    ----------
    variant : str, optional
        A JIT variant. Default: `$DRCMITSUBA_VARIANT`, else the JIT variant that is already set,
        else `cuda_ad_mono` where there is a GPU whose driver fits, else `llvm_ad_mono`.

    Returns
    -------
    str
        Name of the variant that is now set.

    Raises
    ------
    BackendError
        The variant is unknown or no JIT variant, or its backend is missing or unfit.

    Examples
    --------
    >>> import drcmitsuba
    >>> drcmitsuba.backend.select() in ("llvm_ad_mono", "cuda_ad_mono")
    True
    """
    current = mi.variant()
    if current is not None and current.startswith("scalar"):
        current = None
    wanted = variant or os.environ.get("DRCMITSUBA_VARIANT") or current
    variant = wanted or ("cuda_ad_mono" if cuda_available() else "llvm_ad_mono")
    if variant not in mi.variants() or variant.startswith("scalar"):
        known = ", ".join(v for v in mi.variants() if not v.startswith("scalar"))
        raise BackendError(f"variant {variant!r} is none of {known}")
    if variant.startswith("llvm"):
        check_llvm()
    elif not cuda_available():
        fault = cuda_fault()
        why = f"its driver does not fit: {fault}" if fault else "none was found"
        remedy = DRIVER_REMEDY if fault else "set DRCMITSUBA_VARIANT=llvm_ad_mono"
        raise BackendError(f"variant {variant!r} needs a CUDA GPU and {why}; {remedy}")
    if mi.variant() != variant:
        with rewriting_later():
            mi.set_variant(variant)
    if variant.startswith("cuda") and (fault := ray_tracing_fault()):
        if wanted is None:
            return select("llvm_ad_mono")
        raise BackendError(f"the GPU's driver does not fit: {fault}; {DRIVER_REMEDY}")
    return variant


def report() -> dict[str, str]:
    """Backends, number of threads and versions of packages by name, for `drcmitsuba doctor`.

    Beside the version of LLVM stand its file, who brought it, and what was passed over and why.
    """
    version = llvm_version()
    search = llvm_library.use()
    fault = cuda_fault()
    missing = f"not used: {fault}" if fault else "not found"
    out = {
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "LLVM": ".".join(map(str, version)) if version else f"not found{_why_no_llvm()}",
    }
    if version:
        by_itself = search.is_late or search.chosen is None
        out["LLVM from"] = "the search of Dr.Jit" if by_itself else str(search.chosen)
    if version and search.unfit:
        out["passed over"] = search.faults
    out |= {
        "GPU (CUDA)": "found" if cuda_available() else missing,
        "threads": str(dr.thread_count()),
        "kernels": kernel_folder.check() or f"kept in {kernel_folder.kernel_folder()}",
    }
    for package in ("drcmitsuba", "mitsuba", "drjit", "numpy", "xarray", "zarr", "pvlib"):
        out[package] = metadata.version(package)
    return out
