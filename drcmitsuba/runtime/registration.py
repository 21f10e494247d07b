"""LLVM is found, and plugins are registered, as soon as any module imports Dr.Jit or Mitsuba.

Importing Mitsuba takes seconds, so `import drcmitsuba` does not import it. The library of LLVM is
named before Dr.Jit looks for it. The plugins are registered at once where Mitsuba is imported
already, else right after its import.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType


class _AroundMitsuba(MetaPathFinder):
    """Finder that leaves Dr.Jit and Mitsuba to the other finders, and acts before and after."""

    def __init__(self) -> None:
        self._is_searching = False

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of Mitsuba with a loader that registers the plugins afterwards."""
        if name == "drjit":
            importlib.import_module("drcmitsuba.runtime.llvm_library").use()
        if name != "mitsuba" or self._is_searching:
            return None
        self._is_searching = True
        try:
            spec = importlib.util.find_spec(name)
        finally:
            self._is_searching = False
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                _register()

            spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec


def _register() -> None:
    importlib.import_module("drcmitsuba_plugins")


def register_plugins() -> None:
    """Make the plugins known to Mitsuba, now or as soon as it is imported."""
    if "mitsuba" in sys.modules:
        _register()
    elif not any(isinstance(finder, _AroundMitsuba) for finder in sys.meta_path):
        sys.meta_path.insert(0, _AroundMitsuba())
