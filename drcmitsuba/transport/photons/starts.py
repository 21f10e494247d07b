"""Photons start on the ports of several components, which fly in common launches.

A launch for each component would be recorded anew for each: that of the BSDFs of a hall with 36
light pipes takes as long as their photons.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.random_streams import even_numbers, even_order
from drcmitsuba.scene.geometry import is_triangle
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.photons.changing_panes import ChangingPanes
from drcmitsuba.transport.photons.ports import ComponentPorts, PhotonSources, Start
from drcmitsuba.transport.rays.shadow_rays import straight

PILOT = 4096
"""Number of rays from a port that test its view of sky and ground."""


class PhotonRows(NamedTuple):
    """Sources and components that they light: each row has its own photons."""

    component: np.ndarray
    source: np.ndarray
    could: tuple[np.ndarray, ...]
    """Upper bound of the area [m²] that ports turn to a row's source, of every component, shape
    (source, port)."""

    @classmethod
    def of(
        cls, every: tuple[ComponentPorts, ...], sources: PhotonSources, sends: np.ndarray
    ) -> PhotonRows:
        """Rows of the sources that send any light, a mask (source,), component by component."""
        could = tuple(ports.could(sources) * sends[:, None] for ports in every)
        lit = [np.flatnonzero(each.any(axis=1)) for each in could]
        component = np.repeat(np.arange(len(every)), [*map(len, lit)])
        return cls(component, np.concatenate(lit), could)

    def __len__(self) -> int:
        """Count the rows."""
        return len(self.source)

    def some(self, here: np.ndarray | slice) -> PhotonRows:
        """Take some rows."""
        return PhotonRows(self.component[here], self.source[here], self.could)

    @property
    def shares(self) -> np.ndarray:
        """Share of a row's photons on each port of its component, 0 beyond, shape (row, port)."""
        out = np.zeros((len(self), max(each.shape[1] for each in self.could)))
        for c, each in enumerate(self.could):
            mine = self.component == c
            out[mine, : each.shape[1]] = each[self.source[mine]]
        return out / out.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class PhotonStarts:
    """Ports of some components of a scene, or of its panes."""

    every: tuple[ComponentPorts, ...]
    panes: ChangingPanes | None = None

    @property
    def scene(self) -> Scene:
        """Scene of all ports."""
        return self.every[0].scene

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components; "" stands for the panes."""
        return tuple(ports.name for ports in self.every)

    @cached_property
    def _first(self) -> np.ndarray:
        """First port of every component, and at last their number."""
        return np.cumsum([0, *map(len, self.every)])

    @cached_property
    def _tables(self) -> list[mi.Float]:
        """Corner, edges and normal of every port, flat (port, 3)."""
        parts = zip(*((*ports.edges, ports.normal) for ports in self.every), strict=True)
        return [flat(np.concatenate(each)) for each in parts]

    @cached_property
    def _triangular(self) -> np.ndarray:
        return np.concatenate([is_triangle(ports.quads) for ports in self.every])

    def _of_component(self, values: list[float], component: mi.UInt32) -> mi.Float:
        return dr.gather(mi.Float, flat(np.array(values, float)), component)

    def _has(self, flags: list[bool], component: mi.UInt32) -> mi.Bool:
        return dr.gather(mi.Bool, mi.Bool(flags), component)

    def _at(self, port: mi.UInt32, uv: mi.Point2f) -> tuple[mi.Point3f, mi.Normal3f]:
        """Point on a port and the port's normal."""
        at, u, v, n = (dr.gather(mi.Vector3f, column, port) for column in self._tables)
        fold = dr.gather(mi.Bool, mi.Bool(self._triangular), port) & (uv.x + uv.y > 1)
        uv = dr.select(fold, 1 - uv, uv)
        return mi.Point3f(at + uv.x * u + uv.y * v), mi.Normal3f(n)

    def _visible(
        self, p: mi.Point3f, d: mi.Vector3f, flux: mi.Float, component: mi.UInt32
    ) -> mi.Float:
        """Flux that reaches points on ports of components along directions d to the source."""
        if any(ports.in_line for ports in self.every):
            flux = dr.select(self._passed(p, d, component), 0, flux)
        exposed = [ports.exposed for ports in self.every]
        if all(exposed):
            return flux
        free = self._has(exposed, component)
        seen = straight(self.scene, p, d, (flux > 0) & ~free)
        return flux * dr.select(free, 1, seen)

    def _passed(self, p: mi.Point3f, d: mi.Vector3f, component: mi.UInt32) -> mi.Bool:
        """Whether light from directions d passes another port of the component before the points.

        Products of a point with the dual edges are its coordinates in the parallelogram.
        """
        dual: list[list[np.ndarray]] = []
        for ports in self.every:
            corner, u, v = ports.edges
            n, area = ports.normal, np.linalg.norm(np.cross(u, v), axis=1)[:, None]
            dual.append([corner, np.cross(v, n) / area, np.cross(n, u) / area, n])
        tables = [flat(np.concatenate(each)) for each in zip(*dual, strict=True)]
        most = flat(np.where(self._triangular, 1.0, 2.0))
        ends = np.where([ports.in_line for ports in self.every], self._first[1:], self._first[:-1])
        begin, end = (
            dr.gather(mi.UInt32, flat_indices(each), component) for each in (self._first[:-1], ends)
        )
        return _crossed(tables, most, begin, end, p, d)

    def start(
        self,
        sources: PhotonSources,
        rows: PhotonRows,
        photons: int,
        seeds: np.ndarray,
        lane: mi.UInt32,
    ) -> Start:
        """Start some photons from the sources of rows, numbered by `lane`.

        A port is chosen with a probability proportional to `could`. The points of one source are
        spread evenly over the ports and the source.

        Parameters
        ----------
        photons : int
            Number of photons of a row.
        seeds : np.ndarray of int, shape (component,)
        lane : mi.UInt32
            Place in `rows` · photons + the photon's number.

        Returns
        -------
        Start
            Where panes may change, light from the ports of panes counts as having passed one.
        """
        each = dr.opaque(mi.UInt32, photons)
        place, index = lane // each, self._index(rows, lane, photons)
        source, component = (
            dr.gather(mi.UInt32, flat_indices(column), place)
            for column in (rows.source, rows.component)
        )
        share = rows.shares
        most, table = share.shape[1], flat(np.cumsum(share, axis=1))
        number = dr.gather(mi.UInt32, mi.UInt32(sources.numbers), source)
        seed = self.seed(seeds, component)
        where, at = (even_numbers(index, number, seed, pair) for pair in (0, 1))
        row, last = place * dr.opaque(mi.UInt32, most), flat_indices(np.diff(self._first) - 1)
        port = dr.binary_search(
            0, most - 1, lambda i: dr.gather(mi.Float, table, row + i) <= where.x
        )
        port = dr.minimum(port, dr.gather(mi.UInt32, last, component))
        chance = dr.gather(mi.Float, flat(share), row + port)
        before = dr.gather(mi.Float, table, row + port) - chance
        where.x = dr.clip((where.x - before) / chance, 0, 1)
        port += dr.gather(mi.UInt32, flat_indices(self._first), component)
        p, n = self._at(port, where)
        d = sources.draw(source, at)
        offset = self._of_component([ports.offset for ports in self.every], component)
        p = mi.Point3f(p + offset * d)
        area = np.concatenate([ports.area for ports in self.every])
        flux = dr.gather(mi.Float, flat(sources.solid_angle), source)
        flux *= dr.gather(mi.Float, flat(area), port)
        flux *= dr.maximum(-dr.dot(d, n), 0) / (chance * mi.Float(each))
        bins = dr.gather(mi.UInt32, flat_indices(sources.bins), source)
        by_pane = self._by_pane(p, d, component)
        seen_flux = self._visible(p, d, dr.select(chance > 0, flux, 0), component)
        return Start(p, -d, seen_flux, source, bins, index, component, by_pane)

    def seed(self, seeds: np.ndarray, component: mi.UInt32) -> mi.UInt32:
        """Seed of the photons of components, of the `seeds` (component,)."""
        return dr.gather(mi.UInt32, flat_indices(seeds & 0xFFFFFFFF), component)

    def _by_pane(self, p: mi.Point3f, d: mi.Vector3f, component: mi.UInt32) -> mi.Bool:
        """Whether light passes a pane that may change on its way to points on ports."""
        panes, lanes = self.panes, dr.width(component)
        if panes is None:
            return dr.opaque(mi.Bool, False, lanes)  # a literal: compiled anew
        behind = [bool(x.name) and panes.stand_before(x.quads, x.normal) for x in self.every]
        by_pane = self._has([not ports.name for ports in self.every], component)
        if any(behind):
            here = self._has(behind, component)
            self.scene.ray_counter.add("shadow", here, lanes)
            by_pane |= panes.passed(p, d, here)
        return by_pane

    def _index(self, rows: PhotonRows, lane: mi.UInt32, photons: int) -> mi.UInt32:
        """Index of the photon of a lane among the `photons` of its row.

        Photons that start side by side, at heights that follow one another, have similar ways: they
        fill the lanes of a processor better.
        """
        each = dr.opaque(mi.UInt32, photons)
        orders = np.concatenate([even_order(photons, dimension)[0] for dimension in (0, 1)])
        is_second = np.array([ports.rises_along_v for ports in self.every], int)
        turn = dr.gather(mi.UInt32, flat_indices(is_second[rows.component]), lane // each)
        return dr.gather(mi.UInt32, flat_indices(orders), turn * each + lane % each)

    def sky_share(self, seed: int = 0) -> list[np.ndarray]:
        """Share of its cosine-weighted hemisphere that every port of each component sees.

        It is that of sky and ground, shape (port,) each.
        """
        counts = np.diff(self._first)
        local = flat_indices(np.concatenate([np.arange(n) for n in counts]))
        lane = dr.arange(mi.UInt32, self._first[-1] * PILOT)
        port, index = lane // PILOT, lane % PILOT
        component = flat_indices(np.repeat(np.arange(len(counts)), counts))
        component, row = (dr.gather(mi.UInt32, x, port) for x in (component, local))
        p, n = self._at(port, even_numbers(index, row, seed, 0))
        at = even_numbers(index, row, seed, 1)
        d = mi.Frame3f(mi.Normal3f(-n)).to_world(mi.warp.square_to_cosine_hemisphere(at))
        seen = self._visible(p, d, dr.full(mi.Float, 1 / PILOT, dr.width(lane)), component)
        shares = np.asarray(dr.block_sum(seen, PILOT).numpy(), float)
        return np.split(shares, self._first[1:-1])


@symbolic
def _crossed(
    tables: list[mi.Float], most: mi.Float, begin: mi.UInt32, end: mi.UInt32,
    p: mi.Point3f, d: mi.Vector3f,
) -> mi.Bool:  # fmt: skip
    """Whether rays cross any of some parallelograms (corner, dual edges, normal) from the front.

    The sum of a point's coordinates is at most `most`: 2, or 1 for a triangle.
    """
    i, crossed = mi.UInt32(begin), mi.Bool(False)
    while dr.hint(i < end, exclude=[tables, most, p, d, end]):
        corner, u, v, n = (dr.gather(mi.Vector3f, table, i) for table in tables)
        t = dr.dot(corner - p, n) / dr.dot(d, n)
        at = p + t * d - corner
        a, b = dr.dot(at, u), dr.dot(at, v)
        inside = (a >= 0) & (a < 1) & (b >= 0) & (b < 1) & (a + b < dr.gather(mi.Float, most, i))
        crossed |= (dr.dot(d, n) < 0) & (t > 0) & inside
        i += 1
    return crossed
