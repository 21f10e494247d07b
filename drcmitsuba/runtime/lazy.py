"""Names of a package that are imported at their first use."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from functools import partial
from types import ModuleType


def submodule(package: str, name: str) -> ModuleType:
    """Import a module of a package, whose own modules then resolve in the same way.

    Parameters
    ----------
    package, name : str
        Full name of the package, and name of the module in it.

    Returns
    -------
    ModuleType

    Raises
    ------
    AttributeError
        The package has no such module.
    """
    full = f"{package}.{name}"
    if name.startswith("_") or importlib.util.find_spec(full) is None:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    module = importlib.import_module(full)
    if hasattr(module, "__path__"):
        vars(module).setdefault("__getattr__", partial(submodule, full))
    return module


def attributes(package: str, names: Mapping[str, str]) -> Callable[[str], object]:
    """Make the function `__getattr__` of a package.

    Parameters
    ----------
    package : str
        Full name of the package.
    names : mapping of str to str
        Places of the public names in the package: "room.module" for a module under another name,
        "room.module:name" for a class or function.

    Returns
    -------
    callable
        Function that imports one of these names, or any module of the package.
    """

    def resolve(name: str) -> object:
        if name not in names:
            return submodule(package, name)
        path, _, attribute = names[name].partition(":")
        module = importlib.import_module(f"{package}.{path}")
        return getattr(module, attribute) if attribute else module

    return resolve
