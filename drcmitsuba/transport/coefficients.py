"""Daylight coefficients C = D(sensors) + G·D(cells), with the standard error of every entry.

Replicates have independent gather paths, points on the cells, rays to the sky and directions on
the suns. Their mean is the estimate; their scatter gives its standard error. Random numbers depend
on the sensor, cell or sun that they serve, not on the launch.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, replace
from functools import reduce
from typing import IO, Any

import drjit as dr
import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.blocks.block_folder import NOTHING_KEPT, BlockSeries
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.block_content import BlockContent
from drcmitsuba.transport.coefficient_arrays import (
    PARTS,
    Bins,
    Statistics,
    dark,
    joined,
    with_values,
    without_values,
)
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.own_exits import Passages
from drcmitsuba.transport.photons.light import FluxLedger, Landed
from drcmitsuba.transport.photons.tracer import PhotonTracer
from drcmitsuba.transport.rays.openings import within_of
from drcmitsuba.transport.rays.straight_suns import sensor_numbers
from drcmitsuba.transport.replicate import Replicates
from drcmitsuba.transport.shared_paths import SharedPaths

HELD = 1 << 29
"""Largest size of the light on cells in all replicates that stays in memory [bytes]."""
SEEDS = 1 << 30
"""Number of seeds that an accuracy may have."""
TOGETHER = 512
"""Number of sensors in several rooms that share light on cells: more need more memory at once."""
PHOTONS_SHARE = 0.8
"""Share of the progress bar that photons take."""


def compute(
    scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns, accuracy: Accuracy, *,
    subdivision: int | None = 1, kept: BlockSeries = NOTHING_KEPT,
    shared: SharedPaths | None = None, rooms: np.ndarray | None = None,
    progress: Progress = lambda share: None,
) -> xr.Dataset:  # fmt: skip
    r"""Coefficients of sensors for the ground, the sky patches and the suns.

    .. math:: C_{s,b} = \partial E_s / \partial L_b = D_{s,b} + \sum_c G_{s,c} D_{c,b}

    Parameters
    ----------
    scene : Scene
    points, normals : np.ndarray, shape (sensor, 3)
        Positions [m] and unit normals of the sensors.
    suns : Suns
    accuracy : Accuracy
        Samples, cell size, replicates, seed.
    subdivision : int or None
        Reinhart's factor MF of the sky; None leaves out ground and sky.
    kept : BlockSeries
        Stored coefficients of blocks of sensors: those that are there are not computed again, and
        those outside its part are passed over.
    shared : SharedPaths, optional
        Paths and photons that further states of a façade share; without it, none are kept.
    rooms : np.ndarray of int, optional
        Room of every sensor: light on cells is computed for some rooms after another, see
        `groups_of`. By default all sensors share it.
    progress : callable
        Takes the share of the work that is done.

    Returns
    -------
    xr.Dataset
        `straight`, `direct`, `interreflected` and their `…_se`, dims (sensor, bin), and
        `replicates` of direct + interreflected, dims (replicate, sensor, bin); all in sr.

    Notes
    -----
    Coefficients are 0 for effects that are left out, and for suns that cannot shine in.

    Limits: diffuse surfaces are Lambertian; light that a pane mirrors on its way from the source
    to the first diffuse surface is counted only where photons are followed.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> from drcmitsuba.scene import scene
    >>> from drcmitsuba.sky.sun_models import Suns
    >>> case = drcmitsuba.load_case("office.toml")
    >>> point, up = np.array([[3.0, 1.0, 0.8]]), np.array([[0.0, 0.0, 1.0]])
    >>> C = drcmitsuba.coefficients.compute(
    ...     scene.load(case), point, up, Suns((), np.zeros((0, 3))), case.accuracy
    ... )
    >>> C["direct"].shape
    (1, 146)
    """
    blocks = compute_blocks(
        scene, points, normals, suns, accuracy, subdivision=subdivision, kept=kept,
        shared=shared, rooms=rooms, progress=progress,
    )  # fmt: skip
    return joined(blocks, len(points))


def compute_blocks(
    scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns, accuracy: Accuracy, *,
    subdivision: int | None = 1, kept: BlockSeries = NOTHING_KEPT,
    shared: SharedPaths | None = None, rooms: np.ndarray | None = None,
    progress: Progress = lambda share: None,
) -> Iterator[tuple[slice, xr.Dataset]]:  # fmt: skip
    """Yield the coefficients of `compute` for one block of sensors after another.

    Arguments are those of `compute`; at no time is more than one block in memory.
    """
    labels = [*(Patches(subdivision).labels if subdivision else ()), *suns.labels]
    if not (scene.effects.sky or scene.effects.ground):
        subdivision = None
    suns = suns.where(scene.effects.enabled_suns(suns))
    if subdivision is None and not suns.labels:
        yield from dark(labels, points, accuracy.replicates)
        return
    bins = Bins.of(labels, [*(Patches(subdivision).labels if subdivision else ()), *suns.labels])
    done = 0
    stored = kept.cover(len(points))
    kept.tell_stored(stored)
    for block, here in enumerate(stored):
        if kept.part.holds(block):
            C = kept.get(here)
            if C is None:
                break
            yield here, C
        done = here.stop
        progress(done / len(points))
    if done == len(points):
        return
    base = Deposit.of(scene, suns.directions, suns.diameter, subdivision, accuracy)
    photons = PhotonTracer.of(
        scene, points, normals, suns.directions, suns.diameter, subdivision, accuracy
    )
    yield from estimate_blocks(
        base, bins, points, normals, photons=photons, kept=kept, progress=progress,
        sun_samples=accuracy.sensor_sun_samples if suns.straight else 0, done=done,
        shared=shared, rooms=None if photons is not None else rooms,
    )  # fmt: skip


def estimate(
    base: Deposit, labels: list[str], points: np.ndarray, normals: np.ndarray, *,
    sun_samples: int, progress: Progress = lambda share: None,
) -> xr.Dataset:  # fmt: skip
    """Coefficients of all sensors, of bins with these labels; else as `estimate_blocks`."""
    blocks = estimate_blocks(
        base, Bins.of(labels), points, normals, sun_samples=sun_samples, progress=progress
    )
    return joined(blocks, len(points))


def estimate_blocks(
    base: Deposit, bins: Bins, points: np.ndarray, normals: np.ndarray, *,
    sun_samples: int, photons: PhotonTracer | None = None, kept: BlockSeries = NOTHING_KEPT,
    done: int = 0, shared: SharedPaths | None = None, rooms: np.ndarray | None = None,
    progress: Progress = lambda share: None,
) -> Iterator[tuple[slice, xr.Dataset]]:  # fmt: skip
    """Yield coefficients for all bins of a deposit, one block of sensors after another.

    Parameters
    ----------
    base : Deposit
        Deposit before `lit`.
    bins : Bins
        Bins of C, among which are all of the deposit.
    sun_samples : int
        Directions from a sensor to every sun; 0 leaves out straight sun.
    photons : PhotonTracer, optional
        Photons for light that components deviate.
    done : int
        Number of sensors whose blocks are left out.
    points, normals, kept, shared, rooms, progress
        As for `compute`; photons do not come in rooms.

    Yields
    ------
    here, C : slice, xr.Dataset
        Sensors of a block, and their coefficients as from `compute`.
    """
    accuracy, numbers = base.accuracy, range(base.accuracy.replicates)
    deposits, landed = tuple(base.lit(r) for r in numbers), list[Landed]()
    if photons is not None:
        progress, traced = part(progress, PHOTONS_SHARE, 1), part(progress, 0, PHOTONS_SHARE)
        dr.flush_malloc_cache()  # photons need memory of other sizes than what is before and after
        seeds = [launch_seed(accuracy.seed, Stream.PHOTONS, r) for r in numbers]
        if shared is not None:
            landed = shared.photons.traced(photons, seeds, traced)
        else:
            for r, seed in enumerate(seeds):
                ended = part(traced, r / len(seeds), (r + 1) / len(seeds))
                landed.append(photons.traced(seed, ended))
        dr.flush_malloc_cache()
    attributes = _photon_attributes(landed) if landed else {}
    groups = groups_of(rooms, len(points))
    content = None
    if len(groups) > 1 and kept.folder is not None:
        content = BlockContent.of(base, bins.labels, sun_samples)
    passages = None if rooms is None else Passages.of(base.scene, accuracy.cell_size)
    for number, some in enumerate(groups):
        if some.stop <= done or (len(groups) > 1 and not kept.part.holds(number)):
            continue
        seed = accuracy.seed if number == 0 else launch_seed(accuracy.seed, Stream.ROOMS, number)
        own = accuracy.model_copy(update={"seed": seed % SEEDS})
        blocks = _of_group(
            tuple(replace(each, accuracy=own) for each in deposits), tuple(landed), bins,
            points[some], normals[some], rooms=None if rooms is None else rooms[some],
            passages=passages, content=content, sun_samples=sun_samples, attributes=attributes,
            kept=kept if len(groups) == 1 else kept.beyond(some.start), done=done - some.start,
            shared=shared,
            progress=part(progress, some.start / len(points), some.stop / len(points)),
        )  # fmt: skip
        for here, C in blocks:
            yield slice(some.start + here.start, some.start + here.stop), C


def groups_of(rooms: np.ndarray | None, sensors: int) -> list[slice]:
    """Consecutive sensors that share light on cells.

    Parameters
    ----------
    rooms : np.ndarray of int, shape (sensor,), optional
        Room of every sensor.
    sensors : int
        Number of sensors.

    Returns
    -------
    list of slice
        At most `TOGETHER` sensors each, unless one room has more; no room is in two of them. All
        sensors where there are no `rooms`. Light that comes from another group's rooms is not lost:
        paths from a group's sensors find all cells that matter to them.
    """
    if rooms is None or sensors <= TOGETHER:
        return [slice(0, sensors)]
    last = np.zeros(int(rooms.max()) + 2, np.int64)  # room −1 is the last entry
    last[rooms] = np.arange(sensors)  # later entries overwrite earlier ones
    ends = np.flatnonzero(np.maximum.accumulate(last[rooms]) == np.arange(sensors)) + 1
    groups, start = list[slice](), 0
    while start < sensors:
        fit = ends[(ends > start) & (ends <= start + TOGETHER)]
        stop = int(fit[-1] if len(fit) else ends[ends > start][0])
        groups.append(slice(start, stop))
        start = stop
    return groups


def _of_group(
    deposits: tuple[Deposit, ...], landed: tuple[Landed, ...], bins: Bins, points: np.ndarray,
    normals: np.ndarray, *, rooms: np.ndarray | None, passages: Passages | None,
    content: BlockContent | None, sun_samples: int, attributes: dict[str, Any], kept: BlockSeries,
    done: int, shared: SharedPaths | None, progress: Progress,
) -> Iterator[tuple[slice, xr.Dataset]]:  # fmt: skip
    """Yield coefficients of sensors that share the light on cells, block by block."""
    base, numbers = deposits[0], range(len(deposits))
    interior = SharedPaths().interior if shared is None else shared.interior
    told = None if rooms is None else np.unique(rooms, return_inverse=True)[1] + 1
    gathered, transfer = interior.of(base.scene, points, normals, base.accuracy, told)
    its = ""
    if content is not None:
        its = content.of_sensors(base, gathered, transfer, points, normals)
    if passages is not None:
        scene = passages.told(base.scene, gathered, points)
        deposits = tuple(replace(each, scene=scene) for each in deposits)
    with ExitStack() as files:
        every = Replicates(numbers, deposits, landed, transfer, len(points))

        def file() -> IO[bytes] | None:
            if kept.folder is None:
                return None
            kept.folder.mkdir(parents=True, exist_ok=True)
            return files.enter_context(tempfile.TemporaryFile(dir=kept.folder))

        batches: Iterable[Replicates] = _lit(every, gathered, file)
        if len(gathered.blocks) > 1:
            batches = [*batches]  # every block asks for them
            dr.flush_malloc_cache()  # once: blocks that fetch their memory anew take longer
        kept.tell_stored(gathered.blocks)
        for block, here in enumerate(gathered.blocks):
            if here.start < done or not kept.part.holds(block):
                continue
            C, own = kept.get(here), kept
            if C is None and its:
                own = kept.of_content(its, here.start, here.stop)
                own.adopt(here)
                C = own.get(here)
            if C is None:
                of_block = part(progress, *(np.array([block, block + 1]) / len(gathered.blocks)))
                C = _of_block(
                    every, batches, gathered, points, normals, here, bins, sun_samples, of_block
                )
                C.attrs |= attributes
                own.put(here, C)
            yield here, C


def _lit(
    every: Replicates, gathered: Gathered, file: Callable[[], IO[bytes] | None]
) -> Iterator[Replicates]:
    """Yield batches of replicates that know the light on cells.

    Large light takes a temporary `file`, where there is one.
    """
    most = max(here.stop - here.start for here in gathered.blocks)
    batches = every.batches(max(most, gathered.cells.count))
    if not gathered.cells.count:
        yield from batches
        return
    keys, drawn = gathered.cells.keys, gathered.drawn
    within = drawn.within
    if within is None:  # no model
        within = within_of(every.deposits[0].scene, drawn.p.numpy().reshape(-1, 3))
    for some in batches:
        some.meet(drawn.of(some.numbers), keys, within)
        some.pack()
        if some.light is not None and some.light.nbytes * len(every) > HELD * len(some):
            parking = file()
            some.light = some.light if parking is None else some.light.parked(parking)
        yield some
        del some  # before the next one is made


def _of_block(
    every: Replicates, batches: Iterable[Replicates], gathered: Gathered, points: np.ndarray,
    normals: np.ndarray, here: slice, bins: Bins, sun_samples: int, progress: Progress,
) -> xr.Dataset:  # fmt: skip
    """Coefficients of a block of sensors."""
    p, n, met = flat(points[here]), flat(normals[here]), gathered.met(here)
    told, base = None if gathered.within is None else gathered.within[here], every.deposits[0]
    within = within_of(base.scene, points[here], told)
    shape = len(every), len(points[here]), len(bins.labels)
    statistics, total = Statistics(), bins.zeros(shape[0] * shape[1])
    disks = base.disks(p, n, sensor_numbers(here), within)

    def add(some: Replicates) -> None:
        straight, direct = some.sensors(p, n, here, sun_samples, within, disks)
        interreflected = some.interreflected(met, here)
        whole = direct.plus(interreflected)
        parts = dict(zip(PARTS, (straight, direct, interreflected), strict=True))
        dr.eval(*straight, *direct, *interreflected, *whole)
        statistics.add(parts, len(some))
        light = (whole.sky.array, whole.sun.array)
        bins.put(total, light, len(some) * shape[1], some.numbers.start * shape[1])
        progress(some.numbers.stop / shape[0])

    for some in batches:
        add(some)
        del some  # before the next one is made
    empty = without_values(bins.labels, points[here])
    every_replicate = total.numpy().reshape(shape)
    return with_values(empty, statistics.arrays(shape[1], bins), every_replicate)


def _photon_attributes(landed: list[Landed]) -> dict[str, Any]:
    """Attributes of C: `photons`, the ledgers as JSON, and `photons_smear`, relative to C: the
    larger one of the sky's light and the suns'.
    """
    ledgers = {
        name: asdict(reduce(FluxLedger.plus, (one.ledgers[name] for one in landed)))
        for name in landed[0].ledgers
    }
    smear = np.stack([one.smear for one in landed])
    # The scatter of the replicates adds its variance to the square.
    square = (smear.mean(axis=0) ** 2 - smear.var(axis=0, ddof=1) / len(smear)).mean(axis=1)
    each = [[light.numpy().sum(axis=1) for light in one.sensors()] for one in landed]
    whole = np.mean(each, axis=(0, 2))
    smeared = np.sqrt(np.maximum(square, 0)) / np.where(whole > 0, whole, np.inf)
    return {"photons": json.dumps(ledgers), "photons_smear": float(smeared.max())}
