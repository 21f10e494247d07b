"""Blocks that were stored before a run began, of which the run tells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from drcmitsuba.runtime.provenance import Provenance, StoredKeys

MOST_LINES = 10
"""Largest number of lines that tell of stored blocks, as of a study's rows."""


@dataclass(frozen=True)
class StoredBefore:
    """Files of a folder of blocks when a run begins; those that its workers add are left out."""

    folder: Path
    keys: StoredKeys
    files: frozenset[Path]
    tell: Callable[[str], None]
    """Function that shows a line to the user."""
    told: set[Path] = field(default_factory=set)
    """Folders of the keys of which the user was told."""

    @classmethod
    def of(cls, folder: Path, tell: Callable[[str], None]) -> StoredBefore:
        """List the blocks of all keys in a folder, which need not exist."""
        return cls(folder, StoredKeys.of(folder), frozenset(folder.glob("*/*.zip")), tell)

    def tell_once(self, about: str, paths: Sequence[Path]) -> None:
        """Tell how many of the blocks of a key were stored; nothing where none was."""
        stored = sum(path in self.files for path in paths)
        if stored:
            blocks = f"{stored} of {len(paths)} blocks"
            line = f"{about}: going on from {blocks} stored in {self.folder}"
            self._tell_once(paths[0].parent, line)

    def tell_other(self, about: str, made: Provenance) -> None:
        """Tell where another program made the blocks, which are made again."""
        if self.keys.are_of_another_program(made):
            which = f"blocks in {self.folder} are of another version or variant"
            self._tell_once(self.folder / made.key, f"{about}: {which}, and made again")

    def _tell_once(self, key: Path, line: str) -> None:
        if key in self.told:
            return
        self.told.add(key)
        if len(self.told) <= MOST_LINES:
            self.tell(line)
        elif len(self.told) == MOST_LINES + 1:
            self.tell(f"further blocks of {self.folder} are used or made again without a line each")
