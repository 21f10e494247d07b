"""Names of a package that are imported at their first use."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from functools import partial
from types import ModuleType


def submodule(package: str, name: str) -> ModuleType:
    """Import the module `name` of a package, whose own modules then resolve in the same way.

    A package without such a module raises AttributeError, as attributes do.
    """
    full = f"{package}.{name}"
    if name.startswith("_") or importlib.util.find_spec(full) is None:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    module = importlib.import_module(full)
    if hasattr(module, "__path__"):
        vars(module).setdefault("__getattr__", partial(submodule, full))
    return module


def attributes(package: str, names: Mapping[str, str]) -> Callable[[str], object]:
    """Make `__getattr__` of a package, which imports one of `names`, or any module of the package.

    The names have their place in the package: "room.module" for a module under another name,
    "room.module:name" for a class or function.
    """

    def resolve(name: str) -> object:
        if name not in names:
            return submodule(package, name)
        path, _, attribute = names[name].partition(":")
        module = importlib.import_module(f"{package}.{path}")
        return getattr(module, attribute) if attribute else module

    return resolve
