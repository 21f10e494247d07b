"""Modules, and names of a package, that are imported at their first use."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from types import ModuleType


class _Later(ModuleType):
    """Module that stands for another until a name of it is used.

    A module is in `sys.modules` while another thread still runs it; importing it again waits for
    that thread.
    """

    def __getattr__(self, name: str) -> object:
        if self.__name__ in sys.modules:
            return getattr(importlib.import_module(self.__name__), name)
        import numpy as np

        with np.printoptions():  # colour-science changes how NumPy prints
            return getattr(importlib.import_module(self.__name__), name)


def module(name: str) -> ModuleType:
    """Module of another package whose import is slow, which is imported when it is first used."""
    return _Later(name)


def hide(package: str) -> None:
    """Let other packages take a package for missing that they import where it is installed.

    Python knows modules of `None` as such. A package that was imported before stays.
    """
    sys.modules.setdefault(package, None)  # type: ignore[arg-type]


def unhide(package: str) -> None:
    """Let a package be found again."""
    if sys.modules.get(package, package) is None:
        del sys.modules[package]


def folder_of(package: str) -> Path:
    """Folder of another package, which is not imported."""
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(package)
    return Path(spec.origin).parent


@cache
def by_itself(package: str, name: str) -> ModuleType:
    """Module of a package that is imported without the rest of the package.

    `pvlib.spa` needs NumPy only, but `import pvlib` takes half a second for SciPy and HTTP.
    """
    spec = importlib.util.spec_from_file_location(name, folder_of(package) / f"{name}.py")
    if spec is None or spec.loader is None:
        raise ModuleNotFoundError(f"{package}.{name}")
    lone = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(lone)
    return lone


def submodule(package: str, name: str) -> ModuleType:
    """Import the module `name` of a package, whose own modules then resolve in the same way.

    A package without such a module raises AttributeError, as attributes do.
    """
    full = f"{package}.{name}"
    if name.startswith("_") or importlib.util.find_spec(full) is None:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    room = importlib.import_module(full)
    if hasattr(room, "__path__"):
        vars(room).setdefault("__getattr__", partial(submodule, full))
    return room


def attributes(package: str, names: Mapping[str, str]) -> Callable[[str], object]:
    """Make `__getattr__` of a package, which imports one of `names`, or any module of the package.

    The names have their place in the package: "room.module" for a module under another name,
    "room.module:name" for a class or function.
    """

    def resolve(name: str) -> object:
        if name not in names:
            return submodule(package, name)
        path, _, attribute = names[name].partition(":")
        room = importlib.import_module(f"{package}.{path}")
        return getattr(room, attribute) if attribute else room

    return resolve
