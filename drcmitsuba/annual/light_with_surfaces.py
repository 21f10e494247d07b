"""Light by element of every set of surfaces that fills bring, simulated before a façade asks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial

import numpy as np

from drcmitsuba.annual.chosen_facade import ChosenFacade, light_of_channels
from drcmitsuba.annual.run import Run
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.elements import LightByElement, compute
from drcmitsuba.transport.elements.light_of_surfaces import AnyLight, LightOfSurfaces
from drcmitsuba.transport.elements.simulate import MOST_BYTES


def light_with_surfaces(
    case: Case, panes: PaneGroups, bringing: Sequence[int], suns: Suns, accuracy: Accuracy,
    effects: EnabledEffects, progress: Progress,
) -> tuple[AnyLight, ...]:  # fmt: skip
    """Light by element of every colour channel, beside the surfaces that the case draws.

    Other arguments and errors are those of `transport.elements.compute`.

    Parameters
    ----------
    bringing : sequence of int
        Openings whose fills bring surfaces; light with other sets of these is simulated when it
        is asked for, see `simulate_sets`.
    """
    if not bringing:
        return light_of_channels(case, panes, suns, accuracy, effects, progress)
    numbers = scene.channels_of(case, effects)
    most = MOST_BYTES // len(numbers)

    def made(channel: int, fills: Sequence[int], most: int, progress: Progress) -> LightByElement:
        return compute(
            case, panes.with_surfaces(bringing, fills), suns, accuracy, effects, channel=channel,
            progress=progress, most_bytes=most,
        )  # fmt: skip

    channels = tuple(
        LightOfSurfaces(case.source, tuple(bringing), partial(made, number), most)
        for number in numbers
    )
    _simulate(channels, [(0,) * len(bringing)], progress)
    return channels


def simulate_sets(channels: Sequence[AnyLight], shares: np.ndarray, run: Run) -> None:
    """Simulate the light beside all sets of surfaces that stand by shares (row, element).

    What was simulated before stays known.

    Raises
    ------
    InputError
        As `LightOfSurfaces.of` and `LightOfSurfaces.fills`.
    """
    every = _of_surfaces(channels)
    for light in every[:1]:
        sets = dict.fromkeys(map(light.fills, np.unique(shares, axis=0)))
        for each in every:
            each.make_room([*sets])
        if lacking := [fills for fills in sets if fills not in light.known]:
            with run.timed("elements") as done:
                _simulate(every, lacking, done)


def simulate_scheduled(facade: ChosenFacade, daylight: Daylight, run: Run) -> None:
    """Simulate the light that a façade lacks in a year; errors are those of `simulate_sets`.

    What rules close is simulated when its hours are summed.
    """
    if _of_surfaces(facade.channels):
        simulate_sets(facade.channels, facade.scheduled(daylight), run)


def _of_surfaces(channels: Sequence[AnyLight]) -> list[LightOfSurfaces]:
    """Light of every channel, where fills bring surfaces; else none."""
    return [light for light in channels if isinstance(light, LightOfSurfaces)]


def _simulate(
    channels: Sequence[LightOfSurfaces], sets: Sequence[tuple[int, ...]], progress: Progress
) -> None:
    """Simulate the light of some sets of surfaces, channel by channel."""
    jobs = [*itertools.product(channels, sets)]
    for i, (channel, fills) in enumerate(jobs):
        channel.of(fills, part(progress, i / len(jobs), (i + 1) / len(jobs)))
