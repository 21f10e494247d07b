"""The LLVM library that Dr.Jit loads: the system's where it is fit, else one of pip or conda.

Dr.Jit takes the library that `DRJIT_LIBLLVM_PATH` names, else the first that it finds, fit or not.
So `use` names one before Dr.Jit is imported, unless the user has. It opens no library: the version
is in a file's name, and the kind of processor in its first bytes, as in those of Python itself.
"""

from __future__ import annotations

import os
import re
import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib import metadata
from pathlib import Path

VARIABLE = "DRJIT_LIBLLVM_PATH"
OLDEST = 17
"""Dr.Jit refuses 14 and older; 15 and 16 abort the process at the first maximum or minimum."""
WHEELS = ("karellen-llvm-core", "llvm-nanobind")
"""Distributions of the extra `llvm` that carry the library."""
PLACES = {
    "linux": (
        "/usr/lib/*-linux-gnu*/libLLVM*.so*", "/usr/lib64/libLLVM*.so*", "/usr/lib/libLLVM*.so*",
        "/usr/lib/llvm*/lib*/libLLVM*.so*", "/usr/lib64/llvm*/lib*/libLLVM*.so*",
        "/usr/local/lib/libLLVM*.so*",
    ),
    "darwin": (
        "/opt/homebrew/opt/llvm*/lib/libLLVM.dylib", "/usr/local/opt/llvm*/lib/libLLVM.dylib",
        "/opt/local/libexec/llvm-*/lib/libLLVM.dylib",
    ),
    "win32": ("{ProgramFiles}/LLVM/bin/LLVM-C.dll",),
}  # fmt: skip
"""Where systems keep the library, by `sys.platform`; variables of the environment in braces."""
PATHS = {"linux": "LD_LIBRARY_PATH", "win32": "PATH"}
NAMES = {"linux": "libLLVM*.so*", "darwin": "libLLVM*.dylib", "win32": "LLVM*.dll"}
CONDA = {"linux": "lib", "darwin": "lib", "win32": "Library/bin"}
"""Folder of libraries in an environment of conda."""
ELSE = ", since the system has none that is fit"
PROCESSORS = {
    62: "x86-64", 183: "arm64", 3: "32-bit x86", 40: "32-bit arm",
    0x8664: "x86-64", 0xAA64: "arm64", 0x14C: "32-bit x86",
    0x01000007: "x86-64", 0x0100000C: "arm64",
}  # fmt: skip
"""Kinds of processors by the number in files of ELF, PE and Mach-O."""
_NUMBER = (r"\.so\.(\d+\.\d+)", r"libLLVM-(\d+[.\d]*)\.(?:so|dylib)", r"llvm[-@/]?(\d+[.\d]*)/lib")


@dataclass(frozen=True)
class Library:
    """A file of LLVM."""

    path: Path
    origin: str
    """Package, system or variable that brought or named it, for messages."""
    version: tuple[int, ...] = ()
    """Version as its name has it; empty where the name has none."""

    @classmethod
    def of(cls, path: Path, origin: str) -> Library:
        """Read the version from the name of the file that a path leads to."""
        real = path.resolve().as_posix()
        found = (re.search(pattern, real) for pattern in _NUMBER)
        number = next((match[1] for match in found if match), "")
        return cls(path, origin, tuple(int(n) for n in number.split(".") if n))

    @cached_property
    def fault(self) -> str:
        """Why Dr.Jit cannot use it; empty where nothing speaks against it."""
        if not self.path.is_file():
            return "does not exist"
        ours, theirs = processor(Path(sys.executable)), processor(self.path)
        if ours and not theirs and sys.platform == "linux":
            return "is no library"
        if ours and theirs and ours != theirs:
            return f"is for {theirs}, and this Python is for {ours}"
        if self.version and self.version[0] < OLDEST:
            number = ".".join(map(str, self.version))
            return f"is LLVM {number}, and {OLDEST} or newer is needed"
        return ""

    def __str__(self) -> str:
        return f"{self.path}, {self.origin}"


@dataclass(frozen=True)
class LibraryChoice:
    """Library of LLVM that is taken, and those that were passed over."""

    chosen: Library | None
    """Library that Dr.Jit is to load; without one, Dr.Jit looks by itself."""
    unfit: tuple[Library, ...] = ()
    """Libraries that were passed over."""
    is_late: bool = False
    """Whether Dr.Jit was imported before, and has looked for a library by itself."""

    @property
    def faults(self) -> str:
        """Sentence on what was passed over; empty where there was nothing."""
        return ", ".join(f"{library.path} {library.fault}" for library in self.unfit)


def processor(path: Path) -> str:
    """Kind of processor that a program or library is for; empty where its file does not say."""
    try:
        with path.open("rb") as file:
            head = file.read(64)
            if head.startswith(b"\x7fELF"):
                (number,) = struct.unpack_from("<H" if head[5] == 1 else ">H", head, 18)
            elif head.startswith(b"MZ"):
                file.seek(struct.unpack_from("<I", head, 60)[0] + 4)
                (number,) = struct.unpack("<H", file.read(2))
            elif head[:4] in (b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe"):
                (number,) = struct.unpack_from("<I", head, 4)
            else:
                return ""
    except (OSError, struct.error):
        return ""
    return PROCESSORS.get(number, f"processor {number}")


def _of_the_system() -> Iterator[Library]:
    """Libraries in the loader's path and in the folders of the system."""
    folders = os.environ.get(PATHS.get(sys.platform, ""), "").split(os.pathsep)
    for folder in filter(None, folders):
        for path in Path(folder).glob(NAMES[sys.platform]):
            yield Library.of(path, f"in {PATHS[sys.platform]}")
    for place in PLACES.get(sys.platform, ()):
        place = place.format_map({"ProgramFiles": "C:/Program Files", **os.environ})
        anchor = Path(place).anchor
        for path in Path(anchor).glob(place.removeprefix(anchor)):
            yield Library.of(path, "of the system")


def _of_python() -> Iterator[Library]:
    """Libraries that came into this environment by pip or conda."""
    for name in WHEELS:
        try:
            wheel = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue
        version = tuple(int(n) for n in re.findall(r"\d+", wheel.version)[:3])
        for file in wheel.files or ():
            if re.fullmatch(r"libLLVM.*\.so\.[\d.]+|LLVM\.dll|l\w+\.dylib", file.name):
                path = Path(str(wheel.locate_file(file))).resolve()
                yield Library(path, f"of {name} {wheel.version}{ELSE}", version)
    if (Path(sys.prefix) / "conda-meta").is_dir():
        folder = Path(sys.prefix) / CONDA[sys.platform]
        for path in folder.glob(NAMES[sys.platform]):
            yield Library.of(path, f"of conda{ELSE}")


def _newest(libraries: Iterator[Library]) -> tuple[Library | None, list[Library]]:
    """Newest library that is fit, and those that are not, without other names of the same file."""
    files = {library.path.resolve(): library for library in libraries}
    fit = [library for library in files.values() if not library.fault]
    unfit = [library for library in files.values() if library.fault]
    return max(fit, key=lambda library: library.version, default=None), unfit


def find() -> LibraryChoice:
    """Look for the library: the user's choice, else the system's, else one that came by pip."""
    if named := os.environ.get(VARIABLE):
        library = Library.of(Path(named), f"named by {VARIABLE}")
        return LibraryChoice(library, (library,) if library.fault else ())
    if sys.platform not in PLACES:
        return LibraryChoice(None)
    system, unfit = _newest(_of_the_system())
    if system and system.version:
        return LibraryChoice(system, tuple(unfit))
    own, others = _newest(_of_python())
    return LibraryChoice(own or system, (*unfit, *others))


@lru_cache(maxsize=1)
def use() -> LibraryChoice:
    """Find the library once a process and name it to Dr.Jit, unless that is imported already."""
    found = find()
    if "drjit" in sys.modules:
        return replace(found, is_late=not os.environ.get(VARIABLE))
    if found.chosen:
        os.environ[VARIABLE] = str(found.chosen.path)
    return found
