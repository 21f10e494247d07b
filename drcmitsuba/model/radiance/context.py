"""Where a statement of a scene file stands, and how much a reading may take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from drcmitsuba.model.notes import Notes
from drcmitsuba.model.radiance.definitions import Definitions
from drcmitsuba.model.radiance.surfaces import SurfacesByModifier
from drcmitsuba.model.radiance.text import FileLine

MOST_BYTES = 1 << 27
"""Largest size of all files together, each as often as it is read [byte]."""
MOST_FILES = 20_000
"""Largest number of files that are read, each as often as it is."""
MOST_QUADS = 1_000_000
"""Largest number of triangles and facets of a model, and of their copies."""
MOST_COPIES = 2_000_000
"""Largest number of copies of all arrays together."""
DEEPEST = 16
"""Largest number of files, each called by the one before."""


@dataclass
class Budget:
    """Bytes, files, surfaces and copies that a reading may still take."""

    bytes: int = MOST_BYTES
    files: int = MOST_FILES
    quads: int = MOST_QUADS
    copies: int = MOST_COPIES

    def spend_file(self, place: FileLine) -> None:
        """Count a file, or a line of arguments; too many raise InputError."""
        self.files -= 1
        if self.files < 0:
            raise place.error("file", f"more than {MOST_FILES} files", "join some of them")

    def spend_quads(self, quads: int, place: FileLine) -> None:
        """Count quads; too many raise InputError."""
        self.quads -= quads
        if self.quads < 0:
            got = f"more than {MOST_QUADS} surfaces"
            raise place.error("model", got, "leave out what no daylight meets")

    def spend_copies(self, copies: int, place: FileLine) -> None:
        """Count copies of arrays; too many raise InputError."""
        self.copies -= copies
        if self.copies < 0:
            raise place.error("xform", f"more than {MOST_COPIES} copies", "make fewer")


@dataclass(frozen=True)
class Context:
    """Where a statement stands, and what it adds to."""

    definitions: Definitions
    surfaces: SurfacesByModifier
    budget: Budget
    notes: Notes
    files: tuple[Path, ...] = ()
    """Files that call for each other, the present one last."""
    real: tuple[Path, ...] = ()
    """The same without links."""
    override: str | None = None
    """Modifier that `xform -m` gives to all surfaces."""
    given: tuple[Path, ...] = ()
    """Folders of the files that make the model."""

    @property
    def folders(self) -> tuple[Path, ...]:
        """Folders in which files are looked for.

        They are the file's, its callers', those of the model's other files, and the present one.
        """
        called = (file.parent for file in reversed(self.files))
        return (*dict.fromkeys((*called, *self.given)), Path())
