r"""Coefficients of a few sensors by the window that light comes in by, and its number of bounces.

.. math:: C_{w,0} = D_w(\text{sensors}), \qquad C_{w,k} = \sum_c G_{k,c} \, D_w(c)

with D_w the deposit by way of window w and G_k the vertices of gather paths after k surfaces. Where
a path has left the room by a window, all light on its further vertices counts with this window.
Paths and random numbers are those of `coefficients.compute` where light is not solved on cells, so
that the parts add up to its result.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.launch_size import PATHS, SENSORS
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Stream, launch_seed, number_in_replicate
from drcmitsuba.scene.scene import Scene
from drcmitsuba.schema import describe, mean_and_error
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.cells.vertices import Vertices
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.gather.blocks import Gathered, Met
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.light.products import RayMatrix, product
from drcmitsuba.transport.photons.light import Landed
from drcmitsuba.transport.photons.tracer import PhotonTracer
from drcmitsuba.transport.windows.deposit import WindowDeposit, WindowPanes, Windows

MOST_BOUNCES = 5
"""Number of bounces from which on light counts together."""
ELSEWHERE, BETWEEN_PANES = "elsewhere", "pane to pane"
"""Names of light that passes no window, and of light from pane to pane."""
MOST_BYTES = 1 << 30
"""Largest memory of the result's replicates [bytes]."""


def most_points(windows: int, bins: int, replicates: int) -> int:
    """Number of sensors whose light by so many windows and bins memory holds."""
    return MOST_BYTES // (4 * replicates * windows * (MOST_BOUNCES + 1) * bins)


def by_window_and_bounce(
    scene: Scene,
    points: np.ndarray,
    normals: np.ndarray,
    suns: Suns,
    accuracy: Accuracy,
    windows: Sequence[WindowPanes],
    *,
    subdivision: int = 1,
    progress: Progress = lambda share: None,
) -> xr.Dataset:
    """Coefficients of sensors by window and number of bounces.

    Parameters
    ----------
    scene : Scene
        Scene whose effects have no `solved_cells`.
    points, normals, suns, accuracy, progress
        As for `coefficients.compute`.
    windows : sequence of Window
    subdivision : int
        Reinhart's factor MF of the sky.

    Returns
    -------
    xr.Dataset
        `by_window` and its standard error `by_window_se`, dims (window, bounces, sensor, bin) [sr].
        After the windows come `ELSEWHERE`, light that passes none of them; components, by name;
        and light from pane to pane. `bounces` is the number of surfaces that sent the light on
        between the window and the sensor, panes included; the last entry, `MOST_BOUNCES`, stands
        for as many or more.

    Raises
    ------
    InputError
        The result is too large.
    """
    labels = [*Patches(subdivision).labels, *suns.labels]
    suns = suns.where(scene.effects.enabled_suns(suns))
    followed = [*Patches(subdivision).labels, *suns.labels]
    base = Deposit.of(scene, suns.directions, suns.diameter, subdivision, accuracy)
    photons = PhotonTracer.of(
        scene, points, normals, suns.directions, suns.diameter, subdivision, accuracy
    )
    tracers = [] if photons is None else _each(photons)
    names = [window.name for window in windows] + [ELSEWHERE]
    names += [name or BETWEEN_PANES for name, _ in tracers]
    shape = (accuracy.replicates, len(names), MOST_BOUNCES + 1, len(points), len(followed))
    if len(points) > most_points(len(names), len(followed), accuracy.replicates):
        got = f"{len(points)} points, {len(names)} windows and {len(followed)} bins"
        raise InputError("lights", "points", got, "take fewer points or time stamps")
    openings = Windows(windows)
    crossings = openings if scene.effects.beyond and windows else None
    gathered = Gathered.of(
        scene, points, normals, accuracy, block=SENSORS, lanes=PATHS, crossings=crossings
    )
    vertices = [*_vertices(gathered, accuracy, len(points))]
    by_window = WindowDeposit.of(base, openings)
    C = np.zeros(shape, np.float32)
    for r in range(accuracy.replicates):
        deposit, seed = base.lit(r), launch_seed(accuracy.seed, Stream.PHOTONS, r)
        landed = [
            tracer.traced(seed + PhotonTracer.APART * i) for i, (_, tracer) in enumerate(tracers)
        ]
        lit = by_window.on_diffusers(deposit, r)
        parts = _on_sensors(by_window, deposit, lit, gathered, points, normals, suns.straight, r)
        for k, D in enumerate((*parts, *(one.sensors().numpy() for one in landed))):
            C[r, k, 0] = D
        if gathered.cells.count:
            of_cells = _on_cells(by_window, deposit, lit, gathered, landed, r)
            for here in vertices:
                C[r, :, 1:, here.sensors] = here.sent(r, of_cells)
        progress((r + 1) / accuracy.replicates)
    mean, error = mean_and_error(C)
    dims = ("window", "bounces", "sensor", "bin")
    coords: dict[str, Any] = {axis: ("sensor", points[:, i]) for i, axis in enumerate("xyz")}
    coords |= {"window": np.array(names, object), "bounces": np.arange(MOST_BOUNCES + 1)}
    coords["bin"] = np.array(followed, object)
    out = xr.Dataset({"by_window": (dims, mean), "by_window_se": (dims, error)}, coords)
    return describe(out.reindex(bin=np.array(labels, object), fill_value=np.float32(0)))


@dataclass(frozen=True, eq=False)
class _Vertices:
    """Vertices of a block of sensors."""

    sensors: slice
    met: Met
    """Rows of which are bounce · sensors + sensor."""
    replicate: mi.UInt32
    """Replicate of each vertex."""

    def sent(self, replicate: int, parts: Sequence[Irradiance]) -> np.ndarray:
        """Light that the cells send to the sensors (window, bounce, sensor, bin) [sr].

        `parts` is the light on the cells by window.
        """
        few, (row, cell, weight, mark) = self.sensors.stop - self.sensors.start, self.met
        mine = self.replicate == dr.opaque(mi.UInt32, replicate)
        rows = MOST_BOUNCES * few
        inside = mine if mark is None else mine & (mark == 0)
        out = [_product(row, cell, weight, inside, rows, D) for D in parts]
        if mark is not None and dr.any(mine & (mark > 0))[0]:
            of_window = row + (mark - 1) * dr.opaque(mi.UInt32, rows)
            every = reduce(Irradiance.plus, parts)
            outside = _product(of_window, cell, weight, mine & (mark > 0), len(out) * rows, every)
            out = [a + b for a, b in zip(out, np.split(outside, len(out)), strict=True)]
        return np.stack(out).reshape(len(out), MOST_BOUNCES, few, -1)


def _product(
    row: mi.UInt32, cell: mi.UInt32, weight: mi.Float, mine: mi.Bool, rows: int, D: Irradiance
) -> np.ndarray:
    """G·D of all bins (row, bin) [sr]; see `products.product`."""
    paths = RayMatrix(row, cell, weight, rows, there=mine)
    return np.concatenate([product(paths, d).numpy() for d in D], axis=1)


def _vertices(gathered: Gathered, accuracy: Accuracy, sensors: int) -> Iterator[_Vertices]:
    """Yield the vertices of every block of sensors with their bounces."""
    lanes = dr.opaque(mi.UInt32, accuracy.replicates * accuracy.paths * sensors)
    for here in gathered.blocks:
        vertices: Vertices = gathered.trace(here)
        if len(vertices) == 0:
            continue
        few = dr.opaque(mi.UInt32, here.stop - here.start)
        bounce = dr.minimum(vertices.tag // lanes, MOST_BOUNCES - 1)
        row, cell = bounce * few + vertices.row % few, gathered.cells.of(vertices)
        replicate = vertices.row // few
        dr.eval(row, cell, replicate)
        yield _Vertices(here, Met(row, cell, vertices.weight, vertices.mark), replicate)


def _each(photons: PhotonTracer) -> list[tuple[str, PhotonTracer]]:
    """Photons of one component each, by name."""
    return [(ports.name, replace(photons, ports=(ports,))) for ports in photons.ports]


def _on_sensors(
    by_window: WindowDeposit, deposit: Deposit, lit: list[Irradiance], gathered: Gathered,
    points: np.ndarray, normals: np.ndarray, straight_suns: bool, replicate: int,
) -> list[np.ndarray]:  # fmt: skip
    """D of the sensors by window (sensor, bin) [sr]."""
    accuracy, within = deposit.accuracy, gathered.within
    p, n, places = flat(points), flat(normals), dr.arange(mi.UInt32, len(points))
    told, here = None if within is None else flat_indices(within), range(replicate, replicate + 1)
    samples = accuracy.sensor_sun_samples if straight_suns else 0
    parts = by_window.parts(
        deposit, lit, p, n, (Stream.SENSORS,), number_in_replicate(places, replicate),
        lambda one: one.straight_on_sensors(p, n, places, here, samples, told),
    )  # fmt: skip
    return [part.numpy() for part in parts]


def _on_cells(
    by_window: WindowDeposit, deposit: Deposit, lit: list[Irradiance], gathered: Gathered,
    landed: list[Landed], replicate: int,
) -> list[Irradiance]:  # fmt: skip
    """D of the cells by window and component, at the points that stand for them [sr]."""
    drawn, keys = gathered.drawn.apart()[replicate], gathered.cells.keys
    p, n, rays, key = drawn.p, drawn.n, deposit.accuracy.cell_sky_rays, (Stream.CELLS,)
    numbers = number_in_replicate(keys, replicate)
    parts = by_window.parts(
        deposit, lit, p, n, key, numbers,
        lambda one: one.straight(p, n, key, rays, numbers=numbers, within=drawn.within),
    )  # fmt: skip
    parts += [one.on(keys) for one in landed]
    dr.eval(parts)
    return parts
