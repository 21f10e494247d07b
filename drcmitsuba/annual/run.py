"""Record that accompanies an evaluation through all of its steps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any

from drcmitsuba.blocks.block_folder import NOTHING_KEPT, BlockFolder, BlockSeries
from drcmitsuba.blocks.part import EVERY_BLOCK, BlockPart
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.runtime.progress import Progress, Stage, silent, timed
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.shared_paths import SharedPaths

MakeElsewhere = Callable[[State, Suns, Progress], None]
"""Function that has other processes make the blocks of a state for some suns."""


@dataclass(frozen=True)
class Run:
    """Seed and effects of an evaluation, with seconds and rays to which all steps add.

    Parameters
    ----------
    seed : int
        Seed of all random numbers, in place of `accuracy.seed` of the case.
    enabled_effects : EnabledEffects
        Effects that are simulated.
    stage : callable
        Shows the stages of the work.
    seconds, ray_counter : dict and Counter of str
        Seconds of the finished stages by name; number of rays so far by kind.
    blocks : BlockFolder, optional
        Coefficients of earlier runs; without it, nothing is stored.
    part : Part
        Blocks that this run makes.
    elsewhere : callable, optional
        Has other processes make blocks before this one looks for them.
    shared : SharedPaths, optional
        Paths that states of the façade share; None where a case has one state.
    """

    seed: int
    enabled_effects: EnabledEffects = ALL_EFFECTS
    stage: Stage = silent
    seconds: dict[str, float] = field(default_factory=dict)
    ray_counter: Counter[str] = field(default_factory=Counter)
    blocks: BlockFolder | None = None
    part: BlockPart = EVERY_BLOCK
    elsewhere: MakeElsewhere | None = None
    shared: SharedPaths | None = field(default_factory=SharedPaths)

    @classmethod
    def of(cls, case: Case, enabled_effects: EnabledEffects = ALL_EFFECTS) -> Run:
        """Make a run with a case's own seed that shows no stages."""
        return cls(case.accuracy.seed, enabled_effects)

    def timed(self, name: str) -> AbstractContextManager[Progress]:
        """Show a stage and record its seconds."""
        return timed(self.stage, name, self.seconds)

    def accuracy(self, case: Case, points: int | None = None) -> Accuracy:
        """Accuracy of so many points, or of all sensors of a case, with the seed of the run."""
        points = len(prepared(case).receivers) if points is None else points
        return case.accuracy.of_points(points).model_copy(update={"seed": self.seed})

    def forget_paths(self) -> None:
        """Give back the memory of paths that states share."""
        if self.shared is not None:
            self.shared.forget()

    @property
    def shares_blocks(self) -> bool:
        """Whether other cases and other weather will use the blocks of this run."""
        return self.blocks is not None and self.blocks.is_shared

    def kept(self, about: str, *content: Any) -> BlockSeries:
        """Blocks that depend on some content, on this program and on the kind of machine."""
        if self.blocks is None:
            return NOTHING_KEPT
        return self.blocks.series(about, *content, part=self.part)

    def blocks_written_beside(self) -> AbstractContextManager[None]:
        """Write blocks in a thread while further ones are made, until the context ends."""
        return nullcontext() if self.blocks is None else self.blocks.writing.opened()

    def distribute(self, state: State, suns: Suns, progress: Progress) -> None:
        """Have other processes make the blocks of a state, where there are any."""
        if self.elsewhere is not None:
            self.elsewhere(state, suns, progress)
