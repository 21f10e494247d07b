"""Cases and micro-structures that come with the package, by name."""

from __future__ import annotations

import difflib
from importlib import resources
from pathlib import Path

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import is_file

OTHER_FILES = {
    ".oct": "a compiled Radiance scene",
    ".epw": "a weather file",
    ".wea": "a weather file",
    ".xml": "no building in gbXML",
}
"""Kinds of files that users may mistake for a case, by ending."""


def shipped_folder() -> Path:
    """Folder of the cases and recipes that come with the package."""
    root = Path(str(resources.files("drcmitsuba") / "scenes"))
    return root if root.is_dir() else root.parent.parent / "scenes"  # an editable install


def _shipped() -> list[str]:
    root = shipped_folder()
    return [p.relative_to(root).with_suffix("").as_posix() for p in root.rglob("*.toml")]


def shipped_cases() -> list[str]:
    """Names of the cases that come with the package, such as `classroom/existing`.

    Examples
    --------
    >>> import drcmitsuba
    >>> drcmitsuba.shipped_cases()[:3]
    ['classroom/existing', 'classroom/o1', 'classroom/o2']
    """
    return sorted(set(_shipped()) - set(shipped_recipes()))


def shipped_recipes() -> list[str]:
    """Names of the micro-structures that come with the package, such as `films/prism`."""
    return sorted(n for n in _shipped() if n.startswith("films/") or n.endswith("/recipe"))


def _is_building(file: Path) -> bool:
    """Whether a file in XML is a building, which is a case by itself."""
    from drcmitsuba.model.gbxml import is_gbxml  # imports parsers that most cases do without

    return file.suffix.lower() == ".xml" and is_gbxml(file)


def locate_case(path: str | Path) -> Path:
    """Path of a case file, or of a shipped case by its name.

    Raises
    ------
    InputError
        There is no such file and no such shipped case, or the file is of another kind.
    """
    if is_file(Path(path), path, "case file"):
        other = OTHER_FILES.get(Path(path).suffix.lower())
        if other is not None and not _is_building(Path(path)):
            remedy = (
                "give a case (TOML), as `drcmitsuba new` writes it, a building, or a shipped case"
            )
            raise InputError(path, "case file", other, remedy)
        return Path(path)
    if str(path) in shipped_cases():
        return shipped_folder() / f"{path}.toml"
    near = difflib.get_close_matches(str(path), shipped_cases(), n=1)
    hint = f"did you mean the shipped case {near[0]}?" if near else "give a case or a building"
    raise InputError(path, "case file", "no such file", hint)
