"""Cases and micro-structures that come with the package, by name."""

from __future__ import annotations

from importlib import resources
from pathlib import Path


def shipped_folder() -> Path:
    """Folder of the cases and recipes that come with the package."""
    root = Path(str(resources.files("drcmitsuba") / "scenes"))
    return root if root.is_dir() else root.parent.parent / "scenes"  # an editable install


def _shipped() -> list[str]:
    root = shipped_folder()
    return [p.relative_to(root).with_suffix("").as_posix() for p in root.rglob("*.toml")]


def shipped_cases() -> list[str]:
    """Names of the cases that come with the package, such as `classroom/existing`."""
    return sorted(set(_shipped()) - set(shipped_recipes()))


def shipped_recipes() -> list[str]:
    """Names of the micro-structures that come with the package, such as `films/prism`."""
    return sorted(n for n in _shipped() if n.startswith("films/") or n.endswith("/recipe"))
