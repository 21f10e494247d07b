"""Daylight coefficients C = D(sensors) + G·D(cells), with the standard error of every entry.

Replicates are independent in everything: gather paths, points on the cells, rays to the sky,
directions on the suns. Their mean is the estimate, their scatter its standard error. New cells that
a later block of sensors meets are added to the deposit; what is known is never traced again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case import Accuracy
from drcmitsuba.scene import Scene
from drcmitsuba.schema import describe, mean_and_error
from drcmitsuba.sky import sun_labels
from drcmitsuba.transport.cells import Cells, Grid, Vertices, draw_points
from drcmitsuba.transport.gather import gather
from drcmitsuba.transport.panes import PanePatches, pane_transfer, settle
from drcmitsuba.transport.shadow_rays import sky_deposit, sun_deposit

BLOCK = 1024
"""Sensors that are gathered at once."""

Progress = Callable[[float], None]
"""Called with the share of the work that is done, 0 to 1."""


@dataclass(frozen=True)
class Suns:
    """Suns that coefficients are wanted for.

    Parameters
    ----------
    labels : tuple of str
    directions : np.ndarray, shape (sun, 3)
        Unit vectors towards them.
    diameter : float
        Angle across a sun [deg].
    """

    labels: tuple[str, ...]
    directions: np.ndarray
    diameter: float = 0.5

    @classmethod
    def of(cls, sun: xr.Dataset, diameter: float) -> Suns:
        """All suns above the horizon, from the result of `sky.sun_position`."""
        labels = sun_labels(sun)
        up = labels != ""
        return cls(tuple(map(str, labels[up])), sun["direction"].values[up], diameter)

    def only(self, labels: np.ndarray) -> Suns:
        """Keep the suns that are named."""
        kept = np.isin(np.array(self.labels, dtype=str), labels)
        names = tuple(n for n, k in zip(self.labels, kept, strict=True) if k)
        return replace(self, labels=names, directions=self.directions[kept])


def _seed(accuracy: Accuracy, *key: int) -> int:
    """Seed of one launch; launches with different keys are independent."""
    return int(np.random.SeedSequence(accuracy.seed, spawn_key=key).generate_state(1)[0])


def _flat(a: np.ndarray) -> mi.Float:
    return mi.Float(np.ascontiguousarray(a, np.float32).ravel())


@dataclass(frozen=True)
class _Deposit:
    """Irradiance D of any receivers, for one replicate.

    `faces` is E of the faces of the scattering panes, None where there are no such panes.
    """

    scene: Scene
    suns: Suns
    subdivision: int
    accuracy: Accuracy
    patches: PanePatches | None
    faces: mi.TensorXf | None = None

    def straight(
        self, p: mi.Float, n: mi.Float, key: tuple[int, ...], sky_rays: int, sun_samples: int = 1
    ) -> mi.TensorXf:
        """Light that comes straight, shape (receiver, bin)."""
        sky = sky_deposit(
            self.scene, p, n, subdivision=self.subdivision, rays=sky_rays,
            seed=_seed(self.accuracy, *key, 0),
        )  # fmt: skip
        if not self.suns.labels:
            return sky
        sun = sun_deposit(
            self.scene, p, n, suns=self.suns.directions, diameter=self.suns.diameter,
            samples=sun_samples, seed=_seed(self.accuracy, *key, 1),
        )  # fmt: skip
        return dr.concat((sky, sun), axis=1)

    def transfer(self, p: mi.Float, n: mi.Float, key: tuple[int, ...]) -> mi.TensorXf:
        """K from the faces of the panes to receivers, shape (receiver, face)."""
        assert self.patches is not None
        return pane_transfer(
            self.scene, self.patches, p, n,
            rays=self.accuracy.pane_points, seed=_seed(self.accuracy, *key, 2),
        )  # fmt: skip

    def with_faces(self, key: tuple[int, ...]) -> _Deposit:
        """Find the irradiance of the panes' faces, light from pane to pane included."""
        if self.patches is None:
            return self
        rng = np.random.default_rng(_seed(self.accuracy, *key, 3))
        p, n = self.patches.face_points(rng)
        received = self.straight(p, n, key, 4 * self.accuracy.cell_sky_rays)
        return replace(self, faces=settle(self.transfer(p, n, key), received))

    def scattered(self, p: mi.Float, n: mi.Float, key: tuple[int, ...]) -> mi.TensorXf | None:
        """Light by way of scattering panes, shape (receiver, bin); None where there are none."""
        return None if self.faces is None else self.transfer(p, n, key) @ self.faces


def _interreflected(
    vertices: Vertices, cell: mi.UInt32, replicate: int, sensors: int,
    deposit: mi.TensorXf, first: int, last: int,
) -> mi.TensorXf:  # fmt: skip
    """G·D of one replicate for the bins first … last − 1, shape (sensor, last − first).

    Cells that none of these bins reach, and bins that reach no cell, are left out of the product.
    """
    cells, bins = deposit.shape
    part = deposit[:, first:last]
    lit, shining = (dr.compress(dr.max(part, axis=a).array > 0) for a in (1, 0))
    n_lit, n_shining = dr.width(lit), dr.width(shining)
    out = dr.zeros(mi.Float, sensors * (last - first))
    if n_lit and n_shining:
        column = dr.full(mi.UInt32, n_lit, cells)
        dr.scatter(column, dr.arange(mi.UInt32, n_lit), lit)
        row = vertices.row - replicate * sensors
        mine = (vertices.row >= replicate * sensors) & (row < sensors)
        at = dr.gather(mi.UInt32, column, cell, mine)
        g = dr.zeros(mi.Float, sensors * n_lit)
        dr.scatter_add(g, vertices.weight, row * n_lit + at, mine & (at < n_lit))
        entry = dr.arange(mi.UInt32, n_lit * n_shining)
        from_row = dr.gather(mi.UInt32, lit, entry // n_shining)
        from_bin = dr.gather(mi.UInt32, shining, entry % n_shining) + first
        d = dr.gather(mi.Float, deposit.array, from_row * bins + from_bin)
        product = mi.TensorXf(g, (sensors, n_lit)) @ mi.TensorXf(d, (n_lit, n_shining))
        entry = dr.arange(mi.UInt32, sensors * n_shining)
        to_bin = dr.gather(mi.UInt32, shining, entry % n_shining)
        dr.scatter(out, product.array, entry // n_shining * (last - first) + to_bin)
    return mi.TensorXf(out, (sensors, last - first))


def compute(
    scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns, accuracy: Accuracy, *,
    subdivision: int = 1, progress: Progress = lambda share: None,
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
    subdivision : int
        Reinhart's factor MF of the sky.
    progress : callable
        Told the share that is done.

    Returns
    -------
    xr.Dataset
        `straight`, `direct`, `interreflected` and their `…_se`, dims (sensor, bin), and
        `replicates` of direct + interreflected, dims (replicate, sensor, bin); all in sr.

    Notes
    -----
    Limits: diffuse surfaces are Lambertian; light that a pane mirrors on its way from the source
    to the first diffuse surface is not counted (that takes panes which see each other).
    """
    grid = Grid.of(scene, accuracy.cell_size)
    patches = PanePatches.of(scene, 2 * accuracy.cell_size) if scene.scattering else None
    base = _Deposit(scene, suns, subdivision, accuracy, patches)
    n_replicates, n_sensors = accuracy.replicates, len(points)
    deposits = [base.with_faces((r, 0)) for r in range(n_replicates)]
    labels = Patches(subdivision).labels + list(suns.labels)
    shape = (n_sensors, len(labels))
    replicates = np.empty((n_replicates, *shape), np.float32)
    parts = {
        f"{name}{suffix}": np.empty(shape, np.float32)
        for name in ("straight", "direct", "interreflected")
        for suffix in ("", "_se")
    }
    cells = Cells.none(grid)
    of_cells: list[mi.TensorXf | None] = [None] * n_replicates
    starts = range(0, n_sensors, BLOCK)
    for block, start in enumerate(starts):
        here = slice(start, min(start + BLOCK, n_sensors))
        count = here.stop - start
        p, n = _flat(points[here]), _flat(normals[here])
        vertices = gather(
            scene, points[here], normals[here], replicates=n_replicates, paths=accuracy.paths,
            grid=grid, seed=_seed(accuracy, block, 4),
        )  # fmt: skip
        known = cells.count
        cells = cells.extended(vertices)
        cell = cells.of(vertices)
        found: dict[str, list[np.ndarray]] = {k: [] for k in parts if not k.endswith("_se")}
        for r, deposit in enumerate(deposits):
            key = (r, 1, block)
            if cells.count > known:
                q, m = draw_points(vertices, cell, known, cells.count - known, r)
                new = deposit.straight(q, m, (*key, 0), accuracy.cell_sky_rays)
                scattered = deposit.scattered(q, m, (*key, 0))
                new = new if scattered is None else new + scattered
                old = of_cells[r]
                of_cells[r] = new if old is None else dr.concat((old, new), axis=0)
                dr.eval(of_cells[r])
            straight = deposit.straight(
                p, n, (*key, 1), accuracy.sensor_sky_rays, accuracy.sensor_sun_samples
            )
            scattered = deposit.scattered(p, n, (*key, 1))
            direct = straight if scattered is None else straight + scattered
            d = of_cells[r]
            if d is None:
                interreflected = dr.zeros(mi.TensorXf, direct.shape)
            else:
                sky_bins = len(labels) - len(suns.labels)
                ranges = ((0, sky_bins), (sky_bins, len(labels)))
                interreflected = dr.concat(
                    [
                        _interreflected(vertices, cell, r, count, d, *ab)
                        for ab in ranges
                        if ab[0] < ab[1]
                    ],
                    axis=1,
                )
            for name, value in zip(found, (straight, direct, interreflected), strict=True):
                found[name].append(value.numpy())
            replicates[r, here] = found["direct"][-1] + found["interreflected"][-1]
            progress((block + (r + 1) / n_replicates) / len(starts))
        for name, values in found.items():
            parts[name][here], parts[f"{name}_se"][here] = mean_and_error(np.stack(values))
    data: dict[str, tuple[tuple[str, ...], np.ndarray]] = {
        name: (("sensor", "bin"), value) for name, value in parts.items()
    }
    data["replicates"] = (("replicate", "sensor", "bin"), replicates)
    coords: dict[str, Any] = {"bin": np.array(labels, dtype=object)}
    coords |= {axis: ("sensor", points[:, i]) for i, axis in enumerate("xyz")}
    return describe(xr.Dataset(data, coords))
