"""Blocks that were stored before a run began, of which the run tells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

MOST_LINES = 10
"""Largest number of lines that tell of stored blocks, as of a study's rows."""


@dataclass(frozen=True)
class StoredBefore:
    """Files of a folder of blocks when a run begins; those that its workers add are left out."""

    folder: Path
    files: frozenset[Path]
    tell: Callable[[str], None]
    """Function that shows a line to the user."""
    told: set[Path] = field(default_factory=set)
    """Folders of the keys of which the user was told."""

    @classmethod
    def of(cls, folder: Path, tell: Callable[[str], None]) -> StoredBefore:
        """List the blocks of all keys in a folder, which need not exist."""
        return cls(folder, frozenset(folder.glob("*/*.zip")), tell)

    def tell_once(self, about: str, paths: Sequence[Path]) -> None:
        """Tell how many of the blocks of a key were stored; nothing where none was."""
        stored = sum(path in self.files for path in paths)
        if not stored or paths[0].parent in self.told:
            return
        self.told.add(paths[0].parent)
        if len(self.told) <= MOST_LINES:
            blocks = f"{stored} of {len(paths)} blocks"
            self.tell(f"{about}: going on from {blocks} stored in {self.folder}")
        elif len(self.told) == MOST_LINES + 1:
            self.tell(f"further blocks stored in {self.folder} are used without a line each")
