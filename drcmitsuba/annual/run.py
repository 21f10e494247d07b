"""Record that accompanies an evaluation through all of its steps."""

from __future__ import annotations

from collections import Counter
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

from drcmitsuba.case.case import Case
from drcmitsuba.runtime.progress import Progress, Stage, silent, timed
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects


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
    """

    seed: int
    enabled_effects: EnabledEffects = ALL_EFFECTS
    stage: Stage = silent
    seconds: dict[str, float] = field(default_factory=dict)
    ray_counter: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, case: Case, enabled_effects: EnabledEffects = ALL_EFFECTS) -> Run:
        """Make a run with a case's own seed that shows no stages."""
        return cls(case.accuracy.seed, enabled_effects)

    def timed(self, name: str) -> AbstractContextManager[Progress]:
        """Show a stage and record its seconds."""
        return timed(self.stage, name, self.seconds)
