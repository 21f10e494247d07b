"""Registration of the plugins as soon as any module imports Mitsuba.

Importing Mitsuba takes seconds and searches LLVM, so `import drcmitsuba` does not import it. The
plugins are registered at once where Mitsuba is imported already, else right after its import.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType


class _AfterMitsuba(MetaPathFinder):
    """Finder that leaves Mitsuba to the other finders, and imports the plugins after it."""

    def __init__(self) -> None:
        self._is_searching = False

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of Mitsuba with a loader that registers the plugins afterwards."""
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
    elif not any(isinstance(finder, _AfterMitsuba) for finder in sys.meta_path):
        sys.meta_path.insert(0, _AfterMitsuba())
