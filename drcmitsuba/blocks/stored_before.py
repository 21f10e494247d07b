"""Blocks that were stored before a run began, of which the run tells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path


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
        if stored and paths[0].parent not in self.told:
            self.told.add(paths[0].parent)
            self.tell(
                f"{about}: going on from {stored} of {len(paths)} blocks stored in {self.folder}"
            )
