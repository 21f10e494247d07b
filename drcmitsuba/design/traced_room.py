"""A room whose paths were traced once: its illuminance at other reflectances, without new rays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.design.annual_illuminance import AnnualIlluminance
from drcmitsuba.design.bounce_counts import Sums, marked, numbered, powers
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import State
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.cells import Cells, Grid, draw_points
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.diffusing_panes import PanePatches
from drcmitsuba.transport.films import Films
from drcmitsuba.transport.gather import gather


class Deposited(NamedTuple):
    """Illuminance of sensors and cells before any diffuse reflection, D·L.

    Parameters
    ----------
    sensors, direct : mi.TensorXf, shape (time, sensor)
        Illuminance before any diffuse reflection, and its part by direct sun [lx].
    cells : mi.TensorXf, shape (time, cell)
        D·L of the cells [lx].
    sensor_means : np.ndarray, shape (replicate, sensor)
        Mean over time in each replicate [lx].
    cell_means : np.ndarray, shape (replicate, cell)
        Mean over time in each replicate [lx].
    """

    sensors: mi.TensorXf
    direct: mi.TensorXf
    cells: mi.TensorXf
    sensor_means: np.ndarray
    cell_means: np.ndarray


@dataclass(frozen=True)
class TracedRoom:
    """A room in one state of its shade.

    Parameters
    ----------
    before : mi.TensorXf, shape (time, sensor)
        Illuminance before any diffuse reflection [lx].
    direct : mi.TensorXf, shape (time, sensor)
        Illuminance by direct sun [lx].
    cells : mi.TensorXf, shape (time, cell)
        D·L of the cells [lx].
    gathered : Sums
        Path weights; place: cell · sensors + sensor.
    means_before : np.ndarray, shape (replicate, sensor)
        Mean of `before` over time, in each replicate [lx].
    means : Sums
        Mean of the interreflected illuminance over time; place: replicate · sensors + sensor.
    digits : list of list of mi.Bool
        Binary digits of every mark's number of hits on every kind of surface.
    """

    before: mi.TensorXf
    direct: mi.TensorXf
    cells: mi.TensorXf
    gathered: Sums
    means_before: np.ndarray
    means: Sums
    digits: list[list[mi.Bool]]

    @classmethod
    def of(
        cls, case: Case, state: State, daylight: Daylight, rho: Mapping[str, float],
        progress: Progress,
    ) -> TracedRoom:  # fmt: skip
        """Trace paths and deposits at some reflectances, and multiply the deposits by L.

        Parameters
        ----------
        case : Case
        state : {"open", "shaded"}
        daylight : Daylight
        rho : mapping of str to float
            Reflectances of the case by key.
        progress : callable

        Returns
        -------
        TracedRoom

        Raises
        ------
        InputError
            No path from a sensor meets a surface.
        """
        a = case.accuracy
        world, marks = marked(case, state, rho)
        points, normals = sensor_points(case)
        grid = Grid.of(world, a.cell_size)
        vertices = gather(
            world, points, normals, replicates=a.replicates, paths=a.paths,
            grid=grid, seed=launch_seed(a.seed, Stream.PATHS), marks=marks,
        )  # fmt: skip
        cells = Cells.none(grid).extended(vertices)
        if not cells.count:
            raise InputError(case.source, "sensors", "no surface in their sight", "add a [room]")
        cell = cells.of(vertices)
        D = _deposited(
            case, world, daylight, points, normals,
            lambda r: draw_points(vertices, cell, cells.count, r)[1:], progress,
        )  # fmt: skip
        assert vertices.mark is not None
        kinds, mark = numbered(vertices.mark)
        row, weight, count = vertices.row, vertices.weight, dr.opaque(mi.UInt32, len(points))
        at = row // count * dr.opaque(mi.UInt32, cells.count) + cell
        mean_there = dr.gather(mi.Float, mi.Float(D.cell_means.ravel()), at)
        size, rows = cells.count * len(points), a.replicates * len(points)
        return cls(
            D.sensors, D.direct, D.cells,
            Sums.of(cell * count + row % count, mark, weight / a.replicates, size),
            D.sensor_means,
            Sums.of(row, mark, weight * mean_there, rows),
            marks.digits(kinds),
        )  # fmt: skip

    def interreflected(self, ratios: list[mi.Float]) -> mi.TensorXf:
        """G·D·L (time, sensor) [lx] at ratios ρ/ρ′ of the reflectances to the traced ones."""
        cells, sensors = self.cells.shape[1], self.before.shape[1]
        G = self.gathered.weighed(powers(ratios, self.digits))
        return self.cells @ mi.TensorXf(G, (cells, sensors))

    def standard_error(self, ratios: list[mi.Float]) -> np.ndarray:
        """Standard error of the mean of E over time, (sensor,) [lx]."""
        inner = self.means.weighed(powers(ratios, self.digits)).numpy()
        total = self.means_before + inner.reshape(self.means_before.shape)
        return total.std(axis=0, ddof=1) / np.sqrt(len(total))


def _deposited(
    case: Case, world: Scene, daylight: Daylight, points: np.ndarray, normals: np.ndarray,
    draw: Callable[[int], tuple[mi.Float, mi.Float]], progress: Progress,
) -> Deposited:  # fmt: skip
    """Average D·L over the replicates; `draw` gives points and normals on the cells for each."""
    a, suns, year = case.accuracy, daylight.suns, AnnualIlluminance.of(daylight)
    panes, size = [panes.quads for panes in world.scattering], 2 * a.cell_size
    base = Deposit(
        world, suns.directions, suns.diameter, case.sky.subdivision, a,
        PanePatches.of(panes, size) if panes else None,
        Films.of(world, size, suns.directions, suns.diameter),
    )  # fmt: skip
    p, n = (mi.Float(x.astype(np.float32).ravel()) for x in (points, normals))
    samples = a.sensor_sun_samples if suns.straight else 0
    sums: tuple[mi.TensorXf, ...] = ()
    sensor_means, cell_means = [], []
    for r in range(a.replicates):
        deposit = base.lit(r)
        straight = deposit.straight(p, n, (Stream.SENSORS, r), a.sensor_sky_rays, samples)
        before = year.by_all(straight.plus(deposit.scattered(p, n, (Stream.SENSORS, r))))
        q, facing = draw(r)
        D = deposit.straight(q, facing, (Stream.CELLS, r), a.cell_sky_rays)
        cells = year.by_all(D.plus(deposit.scattered(q, facing, (Stream.CELLS, r))))
        E = before, year.by_sun(straight), cells
        sums = tuple(x + y for x, y in zip(sums, E, strict=True)) if sums else E
        dr.eval(sums)
        sensor_means.append(dr.mean(before, axis=0).numpy())
        cell_means.append(dr.mean(cells, axis=0).numpy())
        progress((r + 1) / a.replicates)
    sensors, direct, on_cells = (x / a.replicates for x in sums)
    dr.eval(sensors, direct, on_cells)
    return Deposited(sensors, direct, on_cells, np.stack(sensor_means), np.stack(cell_means))
