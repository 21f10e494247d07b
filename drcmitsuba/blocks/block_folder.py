"""Folders of blocks: of one run, which goes on where an earlier one ended, or a shared cache."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import xarray as xr

from drcmitsuba.blocks.block_file import attributes_of, read_block, write_block
from drcmitsuba.blocks.part import EVERY_BLOCK, BlockPart
from drcmitsuba.blocks.stored_before import StoredBefore
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.background import Behind
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.provenance import Provenance

FORMAT = 1
"""Version of the folder's layout; a folder of another one is refused."""
HEADER = "blocks.json"
"""File that says what a cache is."""
OWN_HEADER = {"format": FORMAT, "byte_order": sys.byteorder}
"""Content of this file, beside the limit."""
LIMIT = 20 << 30
"""Largest size of a cache, unless another one was chosen [bytes]."""
ABANDONED = 3600.0
"""Age from which on a temporary file is one of a process that was killed [s]."""
UNFINISHED = "unfinished"
"""Folder in the results' folder that holds the blocks of a run until it ends."""


@dataclass(frozen=True)
class BlockSeries:
    """Blocks of one key, each with some of the sensors; one without a folder keeps nothing."""

    folder: Path | None = None
    about: str = ""
    """Words for lists."""
    notes: list[str] = field(default_factory=list)
    """Notes on damaged blocks, to which this series adds."""
    part: BlockPart = EVERY_BLOCK
    """Blocks that are made; the others are passed over."""
    writing: Behind = field(default_factory=Behind, compare=False, repr=False)
    """Writes blocks, in a thread where one is open."""
    before: StoredBefore | None = None
    """Blocks that were stored before the run; None where nobody is told of them."""
    first: int = 0
    """Number of the sensor that the sensors of its blocks count from."""
    alike: str = ""
    """Name of all that its blocks depend on, which blocks of other keys may share; "" where
    nothing tells."""

    def beyond(self, first: int) -> BlockSeries:
        """Series of all blocks of some sensors, which count from a further one."""
        return replace(self, first=self.first + first, part=EVERY_BLOCK)

    def of_content(self, *content: Any) -> BlockSeries:
        """Series whose blocks depend on some content alone, whatever else its key holds."""
        return replace(self, alike=Provenance.of(FORMAT, *content).key)

    def adopt(self, here: slice) -> None:
        """Take the block of some sensors from another key, where one has the same content."""
        path = self._path(here)
        if not self.alike or path is None or self.folder is None or path.is_file():
            return
        for other in self.folder.parent.glob(f"*/{'[0-9]' * 8}-{'[0-9]' * 8}-{self.alike}.zip"):
            self.folder.mkdir(exist_ok=True)
            with contextlib.suppress(FileNotFoundError), storage.whole(path) as temporary:
                shutil.copyfile(other, temporary)
            return

    def tell_stored(self, every: Sequence[slice]) -> None:
        """Tell the user once how many of these blocks were stored before the run began."""
        if self.before is not None:
            paths = [self._path(here) for here in every]
            self.before.tell_once(self.about, [path for path in paths if path is not None])

    def get(self, here: slice) -> xr.Dataset | None:
        """Dataset of some sensors; None where it is not stored, or damaged."""
        path = self._path(here)
        self.writing.wait(path)
        if path is None or not path.is_file():
            return None
        try:
            data = read_block(path, {"sensor": here.stop - here.start})
        except FileNotFoundError:  # another run has pruned it
            return None
        if data is None:
            self.notes.append(f"block {path.name} of {self.about} was damaged and is made again")
            path.unlink(missing_ok=True)
            return None
        os.utime(path)
        data.attrs.pop("about", None)
        return data

    def put(self, here: slice, data: xr.Dataset) -> None:
        """Store the dataset of some sensors; OSError where the disk is full."""
        path = self._path(here)
        if path is not None:
            data = data.assign_attrs(about=self.about)
            self.writing.do(lambda: write_block(data, path), (path, self.folder))

    def cover(self, sensors: int) -> list[slice]:
        """Stored blocks that hold so many sensors together, in order; empty where some lack."""
        self.writing.wait(self.folder)
        if self.folder is None or not self.folder.is_dir():
            return []
        stored, at = {}, 0
        for path in self.folder.glob("*.zip"):
            first, stop = (*path.stem.split("-"), "")[:2]
            if first.isdecimal() and stop.isdecimal():
                stored[int(first)] = int(stop)
        out = []
        while at < sensors and stored.get(at, 0) > at:
            out.append(slice(at, stored[at]))
            at = stored[at]
        return out if at == sensors else []

    def kept(self, sensors: int, make: Callable[[], xr.Dataset]) -> xr.Dataset:
        """Dataset of all sensors in one block, which is made where it is not stored."""
        here = slice(0, sensors)
        self.tell_stored([here])
        data = self.get(here)
        if data is None:
            data = make()
            self.put(here, data)
        return data

    def _path(self, here: slice) -> Path | None:
        if self.folder is None:
            return None
        start, stop = self.first + here.start, self.first + here.stop
        name = f"{start:08d}-{stop:08d}"
        if self.alike:
            return self.folder / f"{name}-{self.alike}.zip"
        return next(self.folder.glob(f"{name}-*.zip"), self.folder / f"{name}.zip")


NOTHING_KEPT = BlockSeries()
"""Series that keeps nothing."""


@dataclass(frozen=True)
class BlockFolder:
    """Folder of blocks."""

    path: Path
    is_shared: bool = False
    """Whether it is a cache, which stays when a run has ended."""
    notes: list[str] = field(default_factory=list)
    """Notes on damaged blocks."""
    writing: Behind = field(default_factory=Behind, compare=False, repr=False)
    """Writes blocks, in a thread where one is open."""
    before: StoredBefore | None = None
    """Blocks that were stored before the run; None where nobody is told of them."""

    def telling(self, tell: Callable[[str], None]) -> BlockFolder:
        """Return the folder with a function that tells the user of blocks it holds by now."""
        return replace(self, before=StoredBefore.of(self.path, tell))

    @classmethod
    def of_results(cls, results: Path) -> BlockFolder:
        """Folder of the blocks of an unfinished run, in the folder of its results."""
        return cls(results / UNFINISHED)

    @classmethod
    def cache(cls, path: str | Path) -> BlockFolder:
        """Open or make a cache.

        Raises
        ------
        InputError
            The folder may not be written, holds other files, or was made by another version of the
            program or on a machine with another order of bytes.
        """
        folder = Path(path)
        if folder.exists() and not (folder / HEADER).is_file():
            if not folder.is_dir():
                raise InputError(folder, "--cache", "it is a file", "name a folder")
            if any(p.name[0] != "." for p in folder.iterdir()):  # others may be making it
                raise InputError(folder, "--cache", "it holds other files", "name a new folder")
        there = next(p for p in (folder, *folder.absolute().parents) if p.exists())
        if not os.access(there, os.W_OK | os.X_OK):
            got = f"{there} may not be written"
            raise InputError(folder, "--cache", got, "name another folder")
        if not (folder / HEADER).is_file():
            storage.save_json(OWN_HEADER, folder / HEADER)
        try:
            stored = json.loads((folder / HEADER).read_text(encoding="utf-8"))
        except ValueError:
            stored = {}
        for name, own in OWN_HEADER.items():
            if not isinstance(stored, dict) or stored.get(name) != own:
                other = str(stored.get(name) if isinstance(stored, dict) else None)[:20]
                got = f"its {name.replace('_', ' ')} is {other}, not {own}"
                remedy = "it is of another version or machine: remove it, or name another folder"
                raise InputError(folder, "--cache", got, remedy)
        return cls(folder, True)

    def series(self, about: str, *content: Any, part: BlockPart = EVERY_BLOCK) -> BlockSeries:
        """Blocks that depend on some content; `about` are words for lists."""
        made = Provenance.of(FORMAT, *content)
        if self.before is not None:
            self.before.tell_other(about, made)
        return BlockSeries(self.path / made.key, about, self.notes, part, self.writing, self.before)

    @property
    def limit(self) -> int:
        """Largest size of the cache [bytes]."""
        stored = json.loads((self.path / HEADER).read_text(encoding="utf-8"))
        limit = stored.get("limit", LIMIT)
        return limit if isinstance(limit, int) and limit >= 0 else LIMIT

    def set_limit(self, limit: int) -> None:
        """Choose the largest size of the cache [bytes]."""
        storage.save_json(OWN_HEADER | {"limit": limit}, self.path / HEADER)

    def entries(self) -> list[CacheEntry]:
        """Keys with their sizes, the one that was used last first."""
        keys = (CacheEntry.of(folder) for folder in self._keys())
        return sorted((e for e in keys if e is not None), key=lambda e: -e.used)

    def prune(self, limit: int | None = None) -> int:
        """Remove the keys that were not used for longest, until the cache is as small as `limit`.

        Returns
        -------
        int
            Number of bytes that were removed.
        """
        limit = self.limit if limit is None else limit
        self._remove_abandoned()
        left, removed = 0, 0
        for entry in self.entries():
            if left + entry.size <= limit:
                left += entry.size
            else:
                removed += entry.size
                shutil.rmtree(entry.folder, ignore_errors=True)
        return removed

    def finish(self) -> None:
        """End of a run: its own blocks go, a cache is cut to its limit."""
        if self.is_shared:
            self.prune()
        else:
            shutil.rmtree(self.path, ignore_errors=True)

    def _keys(self) -> Iterator[Path]:
        return (p for p in self.path.iterdir() if p.is_dir() and p.name[0] != ".")

    def _remove_abandoned(self) -> None:
        """Remove temporary files of processes that were killed."""
        for folder in self._keys():
            for file in folder.glob(".*"):
                with contextlib.suppress(FileNotFoundError):  # another run has removed it
                    if time.time() - file.stat().st_mtime > ABANDONED:
                        file.unlink()


@dataclass(frozen=True)
class CacheEntry:
    """Blocks of one key in a list."""

    folder: Path
    about: str
    size: int
    """Size of all of its blocks [bytes]."""
    used: float
    """Time of the last use, in seconds since 1970."""

    @classmethod
    def of(cls, folder: Path) -> CacheEntry | None:
        """Entry of a folder; None where it holds no block."""
        files = sorted(folder.glob("*.zip"))
        try:
            states = [file.stat() for file in files]
        except FileNotFoundError:  # another run removes it
            return None
        if not files:
            return None
        about = str(attributes_of(files[0]).get("about", "damaged"))
        return cls(folder, about, sum(s.st_size for s in states), max(s.st_mtime for s in states))
