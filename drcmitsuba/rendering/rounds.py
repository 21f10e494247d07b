"""Rounds of further rays, averaged until pictures are as sure as wanted or the time is over.

A round is the whole view traced anew with other random numbers, the light on its surfaces, too. The
pictures of some instants and states share it; only they and the light paths of two rounds are in
memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from drcmitsuba.case.accuracy import Target
from drcmitsuba.case.groups import State
from drcmitsuba.rendering.prepared_view import PreparedView
from drcmitsuba.rendering.rendering import Rendering, Source
from drcmitsuba.rendering.view_parts import MOST_MEMORY
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.runtime.time_limit import TimeLimit

TOGETHER = 1 << 28
"""Largest size of the pictures that share rounds [bytes]."""
PIXEL_BYTES = 28
"""Size of a pixel of a mean: three channels, its error, the sun's disk, squares."""
MANY = 8
"""Number of rounds from which their own scatter gives the error."""


@dataclass(frozen=True)
class PictureTarget:
    """Error that every picture is to have, and the time for it."""

    percent: float
    """Largest `Rendering.half_width` [%]."""
    seconds: float
    """Time for further rounds of all pictures [s]; no round begins after it."""

    @classmethod
    def parse(cls, text: str, seconds: float) -> PictureTarget:
        """Read a target such as "2 %".

        Raises
        ------
        InputError
            The text is something else, not above 0 or more than 100; or the time is not above 0.
        """
        try:
            target = Target.parse(text)
        except InputError:
            target = None
        if target is None or target.unit != "%":
            remedy = 'write "2 %", of the luminance of a pixel'
            raise InputError("picture", "target", repr(text), remedy)
        if not seconds > 0:
            raise InputError("picture", "time limit", f"{seconds:g} s", "give more than 0 s")
        return cls(target.value, seconds)

    def holds(self, shown: Rendering) -> bool:
        """Whether a picture has the target."""
        return shown.half_width <= self.percent


@dataclass(frozen=True, eq=False)
class Mean:
    """Mean of independent rounds of one picture."""

    shown: Rendering
    """Mean, with its error."""
    rounds: int = 1
    squares: np.ndarray | float = 0.0
    """Sum of the squared deviations of the rounds' luminances from their mean, (row, column)."""

    def added(self, more: Rendering) -> Mean:
        """Mean with a further round, which shares no random numbers with the others.

        The error follows from the errors of the rounds, and from `MANY` rounds on from the scatter
        of the rounds themselves: replicates of one round divide the pixel among them, so that
        their scatter is too large at edges.
        """
        n, was = self.rounds + 1, self.shown
        rgb = was.picture.rgb + (more.picture.rgb - was.picture.rgb) / np.float32(n)
        picture = replace(was.picture, rgb=rgb)
        before, after = (p.luminance.astype(float) for p in (was.picture, picture))
        new = more.picture.luminance
        squares = self.squares + (new - before) * (new - after)
        if n < MANY:
            error = np.hypot(np.float32(self.rounds) * was.error, more.error) / np.float32(n)
            freedom = was.freedom + more.freedom
        else:
            error = np.sqrt(np.maximum(squares, 0) / (n * (n - 1))).astype(np.float32)
            freedom = n - 1
        shown = replace(was, picture=picture, error=error, freedom=freedom)
        return Mean(shown, n, squares)


def toward(
    target: PictureTarget, prepared: PreparedView, frames: Sequence[tuple[np.datetime64, State]],
    source: Source, folder: Path | None, progress: Progress = lambda share: None,
) -> Iterator[Rendering]:  # fmt: skip
    """Pictures of a view at some instants and states, with rounds until each has the target.

    Parameters
    ----------
    target : PictureTarget
        Its time is for these frames; those that are in memory together have their share of it.
    prepared : PreparedView
        View with the light paths of the first round.
    frames : sequence of (np.datetime64, str)
        Instants, each with the state of the façade.
    source : {"all", "sky", "sun"}
    folder : Path, optional
        Folder for light paths that may not fit in memory, of one round at a time; they are removed.
    progress : callable

    Yields
    ------
    Rendering
        One for each frame, with a note on what it reached.
    """
    first = prepared.channels[0]
    each = PIXEL_BYTES * first.rows * first.columns
    step = max(1, TOGETHER // each)
    for start in range(0, len(frames), step):
        some = frames[start : start + step]
        means = [Mean(prepared.at(instant, source, state)) for instant, state in some]
        limit = TimeLimit(target.seconds * len(some) / len(frames))
        while wide := [k for k, mean in enumerate(means) if not target.holds(mean.shown)]:
            if limit.is_over:
                break
            widest = max(means[k].shown.half_width for k in wide)
            progress((start + len(some) * (target.percent / widest) ** 2) / len(frames))
            number = means[wide[0]].rounds  # as many for all that are still wide
            seed = case_seed(prepared.case.accuracy.seed, Stream.ROUNDS, number)
            with _room(prepared, folder) as there:
                more = prepared.again(seed, None if there is None else Path(there))
                for k in wide:
                    instant, state = some[k]
                    means[k] = means[k].added(more.at(instant, source, state))
                del more  # before the light paths of the next round
        for mean in means:
            yield replace(mean.shown, notes=(*mean.shown.notes, _note(mean, target, limit)))
        progress((start + len(some)) / len(frames))


def _room(prepared: PreparedView, folder: Path | None) -> AbstractContextManager[str | None]:
    """Folder for the light paths of one round, where they may not fit in memory."""
    if folder is None or prepared.nbytes <= MOST_MEMORY:
        return nullcontext()
    return TemporaryDirectory(prefix="round_", dir=folder)


def _note(mean: Mean, target: PictureTarget, limit: TimeLimit) -> str:
    """Error that a picture reached."""
    shown, rounds = mean.shown, mean.rounds
    when = str(shown.time.astype("datetime64[m]"))[5:].replace("T", " ")
    note = f"{when}: luminance of a pixel ±{shown.half_width:.3g} % after {rounds} round"
    note += f"{'s' * (rounds > 1)}, wanted ±{target.percent:g} %"
    return note if target.holds(shown) else f"{note}; the limit of {limit.seconds:g} s is over"
