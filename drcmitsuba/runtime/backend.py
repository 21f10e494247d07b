"""The compiler backend that runs the kernels: LLVM on the processor, CUDA on a GPU.

Dr.Jit loads the newest LLVM on the machine. Versions 15 and 16 abort the whole process at the first
maximum or minimum; Dr.Jit refuses older ones with a traceback. So the program checks the version
before any kernel runs, and refuses an unfit one in one line that says which to install.
"""

from __future__ import annotations

import os
import platform
from importlib import metadata

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.symbolic import rewriting_later

from drcmitsuba.runtime.errors import BackendError

OLDEST_LLVM = 17
REMEDY = (
    "install LLVM 19 (Debian, Ubuntu: apt-get install libllvm19; Fedora: dnf install llvm-libs; "
    "macOS: brew install llvm) or set DRJIT_LIBLLVM_PATH to its libLLVM"
)


def cuda_available() -> bool:
    """Whether Dr.Jit can use a GPU."""
    return bool(dr.has_backend(dr.JitBackend.CUDA))


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
        raise BackendError(f"no LLVM found, or one older than 15; {REMEDY}")
    if version[0] < OLDEST_LLVM:
        number = ".".join(str(v) for v in version)
        raise BackendError(f"LLVM {number} is unfit, {OLDEST_LLVM} or newer is needed; {REMEDY}")


def select(variant: str | None = None) -> str:
    """Set a Mitsuba variant that the program can run on.

    Parameters
    ----------
    variant : str, optional
        A JIT variant. Default: `$DRCMITSUBA_VARIANT`, else the JIT variant that is already set,
        else `cuda_ad_mono` where there is a GPU, else `llvm_ad_mono`.

    Returns
    -------
    str
        Name of the variant that is now set.

    Raises
    ------
    BackendError
        The variant is unknown or no JIT variant, or its backend is missing or unfit.
    """
    current = mi.variant()
    if current is not None and current.startswith("scalar"):
        current = None
    default = "cuda_ad_mono" if cuda_available() else "llvm_ad_mono"
    variant = variant or os.environ.get("DRCMITSUBA_VARIANT") or current or default
    if variant not in mi.variants() or variant.startswith("scalar"):
        known = ", ".join(v for v in mi.variants() if not v.startswith("scalar"))
        raise BackendError(f"variant {variant!r} is none of {known}")
    if variant.startswith("llvm"):
        check_llvm()
    elif not cuda_available():
        raise BackendError(f"variant {variant!r} needs a CUDA GPU and none was found")
    if mi.variant() != variant:
        with rewriting_later():
            mi.set_variant(variant)
    return variant


def report() -> dict[str, str]:
    """Backends, number of threads and versions of packages by name, for `drcmitsuba doctor`."""
    version = llvm_version()
    out = {
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "LLVM": ".".join(map(str, version)) if version else "not found",
        "GPU (CUDA)": "found" if cuda_available() else "not found",
        "threads": str(dr.thread_count()),
    }
    for package in ("drcmitsuba", "mitsuba", "drjit", "numpy", "xarray", "zarr", "pvlib"):
        out[package] = metadata.version(package)
    return out
