"""Parts of a traced view: one for each colour channel or band, traced once and kept on disk."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering import stored_view
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.rendering.light_paths import trace, untraced
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.rendering.view_by_element import ViewByElement
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, part

MOST_MEMORY = 3 << 30
"""Largest size of light paths in memory [bytes]."""


@dataclass(frozen=True)
class ViewPart:
    """Scenes of a channel or a band, and the rays with which a view of them is traced."""

    name: str
    """Name of its folder."""
    scenes: FacadeScenes
    sampling: Sampling
    accuracy: Accuracy
    stated: Mapping[str, Any] = field(default_factory=dict)
    """Content on which its light paths depend, beside that of all parts."""


@dataclass(frozen=True)
class ViewFrame:
    """View, size and sources that all parts of a view share."""

    view: PictureView
    """View in the frame in which the scene is traced."""
    rows: int
    columns: int
    subdivision: int
    """Reinhart's factor MF of the sky."""
    diameter: float
    """Angle across the sun [deg]."""

    def of(self, part: ViewPart) -> dict[str, Any]:
        """Arguments of `trace` and `untraced`."""
        return {
            "scenes": part.scenes, "view": self.view, "rows": self.rows, "columns": self.columns,
            "sampling": part.sampling, "accuracy": part.accuracy,
            "subdivision": self.subdivision, "diameter": self.diameter,
        }  # fmt: skip

    def nbytes(self, part: ViewPart) -> int:
        """Size of a part's light paths [bytes], at most."""
        each = part.sampling.nbytes(part.scenes.looks, len(part.scenes.fills))
        return each * self.rows * self.columns


def traced(
    frame: ViewFrame, parts: Sequence[ViewPart], stated: Mapping[str, Any], folder: Path | None,
    stage: Stage,
) -> tuple[ViewByElement, ...]:  # fmt: skip
    """Trace the parts of a view, or read those of the same view from a folder.

    Parameters
    ----------
    frame : ViewFrame
    parts : sequence of ViewPart
    stated : mapping
        What the light paths depend on, as JSON.
    folder : Path, optional
        Folder for the light paths; without it they stay in memory.
    stage : callable
        Shows the stages of the work.

    Raises
    ------
    InputError
        The light paths may not fit in memory, or on the disk.
    """
    content = [{**stated, "sampling": asdict(p.sampling), **p.stated} for p in parts]
    sizes = np.array([frame.nbytes(p) for p in parts])
    known = folder is not None and all(
        stored_view.is_of(folder / p.name, of) for p, of in zip(parts, content, strict=True)
    )
    if not known:
        _refuse_size(int(sizes.sum()), folder)
    older = folder is not None and stored_view.is_of_another_program(
        folder / parts[0].name, content[0]
    )
    ends = np.r_[0, sizes.cumsum()] / sizes.sum()
    rays = "rays, again: those stored are of another version" if older else "rays"
    views: list[ViewByElement] = []
    with stage(rays) as done, _made(None if known else folder) as made:
        for i, (one, of) in enumerate(zip(parts, content, strict=True)):
            share = part(done, ends[i], ends[i + 1])
            if known and folder is not None:
                begun = untraced(**frame.of(one))
                cells = stored_view.load_cells(folder / one.name, one.accuracy.replicates)
                views.append(replace(begun, cells=cells))
            else:
                views.append(_traced(frame, one, of, made, share))
    if folder is None:
        return tuple(views)
    names = (one.name for one in parts)
    return stored_view.with_tiles_of(views, [folder / name for name in names])


def _traced(
    frame: ViewFrame, one: ViewPart, stated: Mapping[str, Any], made: Path | None, share: Progress
) -> ViewByElement:
    """Trace a part, whose light paths go to a folder where there is one."""
    if made is None:
        return trace(**frame.of(one), progress=share)
    here = made / one.name
    here.mkdir(parents=True)
    keep = partial(stored_view.save_paths, folder=here)
    view = trace(**frame.of(one), progress=share, keep=keep)
    stored_view.save_cells(view.cells, here, dict(stated))
    return view


def _refuse_size(size: int, path: Path | None) -> None:
    """Refuse light paths that may not fit in memory, or on the disk."""
    if path is None:
        if size > MOST_MEMORY:
            got = f"up to {size / 1e6:.0f} MB in memory"
            raise InputError("picture", "size", got, "give a folder for the light paths")
        return
    there = next(p for p in path.absolute().parents if p.exists())
    free = shutil.disk_usage(there).free
    if size > free:
        got = f"up to {size / 1e6:.0f} MB of light paths, {free / 1e6:.0f} MB on the disk"
        raise InputError(path, "size", got, "give a smaller size, or another folder")


@contextmanager
def _made(path: Path | None) -> Iterator[Path | None]:
    """Folder that takes the place of `path` where the block ends without an error."""
    if path is None:
        yield None
        return
    with storage.whole(path) as temporary:
        yield temporary
