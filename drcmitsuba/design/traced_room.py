"""A room whose rays were traced once: its illuminance at other reflectances, without new rays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.design.room_matrices import RoomMatrices
from drcmitsuba.design.surface_kinds import marked
from drcmitsuba.plan import plan
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Stream, launch_seed, number_in_replicate
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.scene import Scene, load
from drcmitsuba.schema import positions
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import blended
from drcmitsuba.sky.sun_models import Blend
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.interreflection.solved_cells import solved
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.photons.tracer import PhotonTracer


@dataclass(frozen=True)
class AnnualIlluminance:
    """E = D·L of receivers over a year: luminances of every time stamp, and bins of its suns.

    Parameters
    ----------
    sky : np.ndarray, shape (time, bin)
        L of sky patches and ground [cd/m²]; the suns' bins follow.
    sun, column : np.ndarray, shape (time, k)
        Luminances of up to k suns [cd/m²], and their bins.
    """

    sky: np.ndarray
    sun: np.ndarray
    column: np.ndarray

    @classmethod
    def of(cls, daylight: Daylight) -> AnnualIlluminance:
        """L and the suns of a case's daylight."""
        sky = daylight.sky
        # An adaptive sun model has no blend: each time stamp's own sun takes its place.
        known = "blend_bin" in sky
        blend = blended(sky) if known else Blend.own(sky["sun_bin"].values)
        labels = [*map(str, sky["bin"].values), *daylight.suns.labels]
        column = positions(blend.bins, labels, missing=0).astype(np.uint32)
        sun = blend.weights * sky["sun"].values[:, None]
        return cls(sky["sky"].values.astype(np.float32), sun.astype(np.float32), column)

    def by_sun(self, d: Irradiance) -> mi.TensorXf:
        """Illuminance E by the suns [lx], shape (time, receiver)."""
        shape = len(self.sky), d.sky.shape[0]
        entry, width = dr.arange(mi.UInt32, shape[0] * shape[1]), dr.opaque(mi.UInt32, shape[1])
        time, receiver = entry // width, entry % width
        out = dr.zeros(mi.Float, dr.width(entry))
        first = dr.opaque(mi.UInt32, d.sky.shape[1])
        for columns, values in zip(self.column.T, self.sun.T, strict=True):
            column = dr.gather(mi.UInt32, flat_indices(columns), time)
            value = dr.gather(mi.Float, flat(values), time)
            here = column < first
            for part, at, mine in ((d.sky, column, here), (d.sun, column - first, ~here)):
                if part.shape[1]:
                    index = receiver * dr.opaque(mi.UInt32, part.shape[1]) + at
                    out += value * dr.gather(mi.Float, part.array, index, mine)
        dr.eval(out)
        return mi.TensorXf(out, shape)

    def by_all(self, d: Irradiance) -> mi.TensorXf:
        """Illuminance E by sky and suns [lx], shape (time, receiver)."""
        E = mi.TensorXf(self.sky) @ d.sky.T + self.by_sun(d)
        dr.eval(E)
        return E


class Deposited(NamedTuple):
    """Illuminance of sensors and cells before any diffuse reflection, D·L [lx].

    Parameters
    ----------
    sensors, direct : mi.TensorXf, shape (time, sensor)
        Illuminance of the sensors, and its part by direct sun.
    cells : mi.TensorXf, shape (time, cell)
    sensor_means, cell_means : np.ndarray, shape (replicate, sensor), (replicate, cell)
        Mean over time in each replicate.
    by_group : tuple of mi.TensorXf, shape (time, sensor)
        Illuminance of the sensors by the direct sun that comes by each group of panes.
    """

    sensors: mi.TensorXf
    direct: mi.TensorXf
    cells: mi.TensorXf
    sensor_means: np.ndarray
    cell_means: np.ndarray
    by_group: tuple[mi.TensorXf, ...] = ()


@dataclass(frozen=True)
class TracedRoom:
    """A room in one state of its shade.

    Parameters
    ----------
    light : RoomMatrices
        From light on cells to that on sensors.
    means : RoomMatrices
        Likewise of each replicate, from its mean over time.
    """

    deposited: Deposited
    light: RoomMatrices
    means: RoomMatrices

    @classmethod
    def of(
        cls, case: Case, state: State, daylight: Daylight, rho: Mapping[str, float],
        progress: Progress, groups: Sequence[np.ndarray] = (),
    ) -> TracedRoom:  # fmt: skip
        """Trace rays and deposits at a case's reflectances `rho`, and multiply deposits by L.

        `groups` are masks (sensor, bin) of straight light that comes by each group of panes.

        Raises
        ------
        InputError
            No path from a sensor meets a surface.
        """
        a = case.accuracy
        world, marks = marked(case, state, rho)
        points, normals = prepared(case).receivers.at()
        n, rooms = len(points), prepared(case).rooms_of(points)
        told = None if rooms is None else np.unique(rooms, return_inverse=True)[1] + 1
        gathered = Gathered.of(
            world, points, normals, a, block=n, lanes=a.replicates * a.paths * n, marks=marks,
            once=True, rooms=told,
        )  # fmt: skip
        if not gathered.cells.count:
            raise InputError(case.source, "sensors", "no surface in their sight", "add a [room]")
        gathered, transfer = solved(world, gathered, a, marks)
        # Images of the suns, and photons, know surfaces by the shapes of the scene as loaded.
        between = plan(case, daylight).scope.pane_to_pane
        loaded = load(case, state, effects=replace(ALL_EFFECTS, pane_to_pane=between))
        D = _deposited(case, loaded, daylight, points, normals, gathered, groups, progress)
        met = gathered.met(slice(0, n))
        return cls(
            D, RoomMatrices.of(met, transfer, n, gathered.cells.count),
            RoomMatrices.of_replicates(met, transfer, n, D.cell_means),
        )  # fmt: skip

    def illuminance(self, ratios: list[mi.Float]) -> mi.TensorXf:
        """E (time, sensor) [lx] at ratios ρ/ρ′ of the reflectances to the traced ones."""
        D = self.deposited
        return D.sensors + D.cells @ self.light.gathered(_by_mark(ratios)).T

    def standard_error(self, ratios: list[mi.Float]) -> np.ndarray:
        """Standard error of the mean of E over time, (sensor,) [lx]."""
        before = self.deposited.sensor_means
        inner = self.means.gathered(_by_mark(ratios)).numpy()
        total = before + inner.reshape(before.shape)
        return total.std(axis=0, ddof=1) / np.sqrt(len(total))


def _by_mark(ratios: list[mi.Float]) -> mi.Float:
    """Factor of every mark of a ray."""
    return dr.concat([mi.Float(1), *ratios])


def _deposited(
    case: Case, world: Scene, daylight: Daylight, points: np.ndarray, normals: np.ndarray,
    gathered: Gathered, groups: Sequence[np.ndarray], progress: Progress,
) -> Deposited:  # fmt: skip
    """Average D·L over the replicates, with the points on the cells that each has drawn."""
    a, suns, year = case.accuracy, daylight.suns, AnnualIlluminance.of(daylight)
    base = Deposit.of(world, suns.directions, suns.diameter, case.sky.subdivision, a)
    p, n, places = flat(points), flat(normals), dr.arange(mi.UInt32, len(points))
    disks = base.disks(p, n, places, None)
    samples = a.sensor_sun_samples if suns.straight else 0
    photons = PhotonTracer.of(
        world, points, normals, suns.directions, suns.diameter, case.sky.subdivision, a
    )
    sums: tuple[mi.TensorXf, ...] = ()
    sensor_means, cell_means = [], []
    for r, on_cells in enumerate(gathered.drawn.apart()):
        deposit, key, cell_key = base.lit(r), (Stream.SENSORS,), (Stream.CELLS,)
        q, facing = on_cells.p, on_cells.n
        numbers = number_in_replicate(places, r)
        straight = deposit.straight_on_sensors(p, n, places, range(r, r + 1), samples, None, disks)
        direct = straight.plus(deposit.scattered(p, n, key, numbers))
        of_cells = number_in_replicate(dr.arange(mi.UInt32, dr.width(q) // 3), r)
        D = deposit.straight(q, facing, cell_key, a.cell_sky_rays, numbers=of_cells)
        D = D.plus(deposit.scattered(q, facing, cell_key, of_cells))
        if photons is not None:
            landed = photons.traced(launch_seed(a.seed, Stream.PHOTONS, r))
            straight = straight.plus(landed.mirrored())
            direct, D = direct.plus(landed.sensors()), D.plus(landed.on(gathered.cells.keys))
        before, cells = year.by_all(direct), year.by_all(D)
        by_group = (year.by_sun(_of_bins(straight, mask)) for mask in groups)
        E = before, year.by_sun(straight), cells, *by_group
        sums = tuple(x + y for x, y in zip(sums, E, strict=True)) if sums else E
        dr.eval(sums)
        sensor_means.append(dr.mean(before, axis=0).numpy())
        cell_means.append(dr.mean(cells, axis=0).numpy())
        progress((r + 1) / a.replicates)
    sensors, sun, lit, *sun_by_group = (x / a.replicates for x in sums)
    dr.eval(sensors, sun, lit, *sun_by_group)
    means = np.stack(sensor_means), np.stack(cell_means)
    return Deposited(sensors, sun, lit, *means, tuple(sun_by_group))


def _of_bins(d: Irradiance, mask: np.ndarray) -> Irradiance:
    """D of some bins, by a mask (receiver, bin)."""
    of_bins = np.split(mask.astype(np.float32), [d.sky.shape[1]], axis=1)
    return Irradiance(
        *(part * mi.TensorXf(np.ascontiguousarray(m)) for part, m in zip(d, of_bins, strict=True))
    )
