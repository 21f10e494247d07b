"""Parts of the blocks of a case, which any process makes that sees the folder of blocks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from drcmitsuba.annual.run import Run
from drcmitsuba.annual.sensor_stream import channel_stream
from drcmitsuba.blocks.block_folder import BlockFolder
from drcmitsuba.blocks.part import BlockPart
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED, State
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, part, silent
from drcmitsuba.scene import scene
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight, daylight_and_year
from drcmitsuba.sky.sun_models import Suns


class _BegunPart(NamedTuple):
    case: Case
    light: Daylight
    run: Run

    def make(self, state: State, suns: Suns, progress: Progress) -> None:
        """Make and store the blocks of the run's part, in all colour channels."""
        channels = scene.channels_of(self.case, self.run.enabled_effects)
        for i, channel in enumerate(channels):
            share = part(progress, i / len(channels), (i + 1) / len(channels))
            for _ in channel_stream(self.case, state, channel, suns, self.run, share):
                pass


def _begun(case: Case, run: Run) -> _BegunPart:
    """Case as it is simulated, its light, and the run with the effects of the case's plan."""
    backend.select()
    light = daylight_and_year(case.with_dark_hours() if run.shares_blocks else case)
    run = replace(run, enabled_effects=plan(case, light).scope)
    shade = run.enabled_effects.shade
    return _BegunPart(case if shade else case.with_tables(shading=None, groups={}), light, run)


@dataclass(frozen=True)
class StatePart:
    """Part of the blocks of one state of a façade; it holds plain values and can be pickled."""

    case: Case
    state: State
    suns: Suns
    seed: int
    blocks: BlockFolder
    part: BlockPart

    def make(self, progress: Progress) -> list[str]:
        """Make and store the blocks that are not there; return notes on damaged ones."""
        if not self.blocks.path.is_dir():
            remedy = "name a folder that all machines see by the same path"
            raise InputError(self.blocks.path, "blocks", "a worker does not see it", remedy)
        run = Run(self.seed, blocks=self.blocks, part=self.part)
        _begun(self.case, run).make(self.state, self.suns, progress)
        return self.blocks.notes


def make_part(case: Case, blocks: BlockFolder, which: BlockPart, stage: Stage = silent) -> None:
    """Make a part of the blocks of all states of a case, for a run with the same cache.

    Any number of processes may make parts at the same time. What is stored stays as it is.

    Parameters
    ----------
    case : Case
    blocks : BlockFolder
        Cache that all parts share.
    which : Part
    stage : callable, optional

    Raises
    ------
    InputError
        The case has an adaptive sun or groups of panes, whose light depends on other blocks.
    """
    if isinstance(case.sun, Adaptive):
        remedy = "leave it out, or take another sun"
        raise InputError(case.source, "--block", "beside an adaptive sun", remedy)
    run = replace(Run.of(case), stage=stage, blocks=blocks, part=which)
    with run.timed("sky"):
        begun = _begun(case, run)
        groups = prepared(begun.case).groups
    if len(groups) > 1 or begun.case.groups:
        remedy = "leave it out, or evaluate with --workers"
        raise InputError(case.source, "--block", "beside groups of panes", remedy)
    states = (OPEN, SHADED) if len(groups) else (OPEN,)
    for state, name in zip(states, ("open façade", "shaded façade"), strict=False):
        with run.timed(name) as done:
            begun.make(state, begun.light.suns, done)
