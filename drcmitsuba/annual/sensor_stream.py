"""Coefficients of a case for one block of sensors after another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from drcmitsuba.annual.pane_group_of_sun import PaneGroupOfSun
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.simulation import block_content, joined_channels, of_points
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, State
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.scene import scene
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute_blocks
from drcmitsuba.transport.sun_interpolation import mesh_of

Stream = Iterator[tuple[slice, xr.Dataset]]
"""Datasets of blocks of sensors, which follow each other."""


MESHED = 1 << 11
"""Number of sensors that share a mesh of suns."""


def sensor_stream(
    case: Case, state: State, suns: Suns, latitude: float, run: Run,
    progress: Progress = lambda share: None,
) -> Stream:  # fmt: skip
    """Yield C of a state [sr] for blocks of sensors, as `simulation.transport` gives it.

    Each block is stored by the run before it is yielded, so that a second stream only reads. Of an
    adaptive sun every block refines a mesh of its own, in the open state.
    """
    (points, normals), at = prepared(case).receivers.at(), prepared(case).receivers.coordinates
    groups = PaneGroupOfSun.of(case, state, suns, run)
    if isinstance(case.sun, Adaptive):
        blocks = _meshed(case, state, suns, latitude, run, progress)
    else:
        blocks = _every_sun(case, state, suns, run, progress)
    for here, C in blocks:
        C = C.assign_coords(at.isel(sensor=here).coords)
        yield here, C if groups is None else groups.added(C, points[here], normals[here])


def _every_sun(case: Case, state: State, suns: Suns, run: Run, progress: Progress) -> Stream:
    """Yield C of all suns."""
    channels = scene.channels_of(case, run.enabled_effects)
    run.distribute(state, suns, progress)
    streams = [
        channel_stream(
            case, state, channel, suns, run,
            part(progress, i / len(channels), (i + 1) / len(channels)),
        )
        for i, channel in enumerate(channels)
    ]  # fmt: skip
    for here, blocks in aligned(streams):
        yield here, joined_channels(blocks)


def _meshed(
    case: Case, state: State, suns: Suns, latitude: float, run: Run, progress: Progress
) -> Stream:
    """Yield C of meshes of suns, and of straight light from all suns."""
    points, normals = prepared(case).receivers.at()
    for start in range(0, len(points), MESHED):
        here = slice(start, min(start + MESHED, len(points)))
        its, mesh = (latitude, points[here], normals[here]), tuple[str, ...]()
        if state != OPEN:
            mesh = mesh_of(of_points(case, OPEN, suns.only(()), *its, run=run, among=len(points)))
        done = part(progress, here.start / len(points), here.stop / len(points))
        C = of_points(case, state, suns, *its, run=run, mesh=mesh, among=len(points), progress=done)
        yield here, C


def channel_stream(
    case: Case, state: State, channel: int, suns: Suns, run: Run, progress: Progress
) -> Stream:
    """Yield C of one colour channel for the blocks of the run's part; its rays are added to it."""
    world = scene.load(case, state, channel, run.enabled_effects)
    points, normals = prepared(case).receivers.at()
    accuracy = run.accuracy(case, len(points))
    subdivision = case.sky.subdivision
    rooms = prepared(case).rooms_of(points)
    content = block_content(world, points, normals, accuracy, subdivision, rooms)
    yield from compute_blocks(
        world, points, normals, suns, accuracy, subdivision=subdivision,
        kept=run.kept(f"{case.name}, {state}", *content, suns), rooms=rooms, progress=progress,
    )  # fmt: skip
    run.ray_counter.update(world.ray_counter.counted())


def aligned(streams: Sequence[Stream]) -> Iterator[tuple[slice, list[xr.Dataset]]]:
    """Yield the datasets of several streams for the same sensors, whatever their blocks are."""
    current: list[tuple[slice, xr.Dataset] | None] = [None] * len(streams)
    at = 0
    while True:
        for i, stream in enumerate(streams):
            held = current[i]
            if held is None or held[0].stop == at:
                current[i] = next(stream, None)
        blocks = [held for held in current if held is not None]
        if len(blocks) < len(streams):
            return
        stop = min(here.stop for here, _ in blocks)
        yield slice(at, stop), [_cut(here, C, at, stop) for here, C in blocks]
        at = stop


def _cut(here: slice, C: xr.Dataset, start: int, stop: int) -> xr.Dataset:
    """Sensors from `start` to `stop` of a block."""
    if (here.start, here.stop) == (start, stop):
        return C
    return C.isel(sensor=np.arange(start, stop) - here.start)
