r"""Deposit by way of films: light that a pane with a measured BSDF scatters once.

Light leaves a film evenly within each outgoing cell of its BSDF. The film's answer to every bin is
tabulated once, by cell; a receiver needs only the cells of the patches that it looks into:

.. math:: D_b[r, b] = \sum_j w_{rj} \, f(\omega_b \to c_j) \, D_a[p_j, b]

with w = cos θ / density of the j-th direction from receiver r to patch p_j, c_j the cell of the
direction back, and D_a the straight irradiance of the patch. For the suns, f is taken at their
exact directions. Within a patch of the sky f varies: there f · D_a is one integral, estimated by
directions drawn from the BSDF.

A film is exposed where nothing lies beyond its plane. All of it is then lit alike, and the sum is a
product of matrices, of the weights w by cell and of the radiance of every cell.

Limits: light from a film or a diffusing pane to another film is not followed here, but by photons
(`photons`, effect `pane_to_pane`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.runtime.flat_arrays import first_of_rows, flat_indices, row_and_column
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.films.answers import (
    EvenAnswer,
    SunCells,
    SunRadiance,
    sampled_answer,
    sky_answer,
)
from drcmitsuba.transport.films.looks import Directions, Looked
from drcmitsuba.transport.films.orientation import Mount, mounts
from drcmitsuba.transport.films.peaks import Peaks, take_out
from drcmitsuba.transport.films.sums import summed, widened
from drcmitsuba.transport.light.products import rows_of
from drcmitsuba.transport.panes.patches import PanePatches, times_narrower
from drcmitsuba.transport.panes.transfer import PaneLook, looks
from drcmitsuba.transport.rays.openings import Within

MOST_ROWS = 1 << 18
"""Largest number of outgoing cells of all patches that are narrow: a row of the table of the sky
each."""
LEAST_DIRECTIONS = 1 << 11
"""Least number of directions to the sky from a patch: a film that scatters evenly is one cell."""
NEAR = 3.0
"""Distance from a film's plane within which surfaces that shade it ask for narrow patches [m]."""
FEW_ROWS = 48
"""Number of outgoing cells per direction to an exposed film up to which its light is a product."""


class LitFilms(NamedTuple):
    """Deposit on films and the radiance that they send on, in one replicate."""

    faces: mi.TensorXf
    """D of the patches' faces [sr], straight from the suns, shape (face, sun)."""
    to_suns: mi.Float
    """f [1/sr] from the suns that may shine on a film into every outgoing cell of every mount,
    shape (row · lit sun,), without `peaks`."""
    to_sky: mi.TensorXf
    """Radiance of every outgoing cell per unit radiance of ground and sky patches, shape
    (row, bin); for the first row of each patch see `Films.first_sky_rows`."""
    peaks: tuple[Peaks, ...] = ()
    """Narrow peaks of films that other surfaces shade, see `peaks`."""


class EvenRows(NamedTuple):
    """Outgoing cells of an exposed film: each sends the same light from all over the film."""

    mount: int
    """Index of the mount."""
    rows: mi.UInt32
    """Rows of the cells within the mount."""


@dataclass(frozen=True)
class Films:
    """The films of a scene, cut into patches."""

    scene: Scene
    mounts: tuple[Mount, ...]
    patches: PanePatches
    """Patches, owned by their mount."""
    fineness: tuple[int, ...]
    """Times that patches of each mount are narrower than those of panes that nothing shades."""
    suns: np.ndarray
    """Indices of the suns that may shine on a film, int, shape (lit,)."""
    directions: np.ndarray
    """Unit vectors to these suns, shape (lit, 3)."""
    diameter: float
    """Angle across a sun [deg]."""

    @classmethod
    def of(cls, scene: Scene, size: float, suns: np.ndarray, diameter: float) -> Films | None:
        """Cut films into patches of about `size` [m]; None without films."""
        if not scene.films:
            return None
        mounted = tuple(mounts(scene))
        every = [m.quads for m in mounted]
        most = MOST_ROWS // max(m.rows for m in mounted)
        fineness = tuple(times_narrower(every, scene.corners, size, most, NEAR))
        patches = PanePatches.of(every, [size / k for k in fineness])
        none = np.zeros(0, int), np.zeros((0, 3))
        return cls(scene, mounted, patches, fineness, *none, diameter).with_suns(suns, diameter)

    def with_suns(self, suns: np.ndarray, diameter: float) -> Films:
        """Return the same films under other suns: unit vectors (sun, 3), angle across [deg]."""
        radius = np.radians(diameter) / 2
        shining = np.zeros(len(suns), bool)
        for mount in self.mounts:
            shining |= (suns @ mount.frame[2] < np.sin(radius)) | (not mount.exposed)
        lit = np.flatnonzero(shining)
        return replace(self, suns=lit, directions=suns[lit], diameter=diameter)

    def only_reflecting(self) -> Films:
        """Return the same films, through which no light passes."""
        return replace(self, mounts=tuple(replace(m, only_reflects=True) for m in self.mounts))

    @cached_property
    def even_answers(self) -> tuple[EvenAnswer | None, ...]:
        """Answers of the mounts that are the same in all replicates."""
        return tuple(
            EvenAnswer.of(mount, self.directions, self.diameter) if mount.bsdf.out_even else None
            for mount in self.mounts
        )

    @cached_property
    def _even_tables(self) -> tuple[mi.Float | None, ...]:
        """The same answers by sun."""
        return tuple(even and even.to_suns(even.f).array for even in self.even_answers)

    def answer_to_suns(self, seed: int) -> mi.Float:
        """Tabulate f [1/sr] from the suns that may shine on a film, see `LitFilms.to_suns`."""
        tables = [
            sampled_answer(self.mounts[i], self.directions, self.diameter, seed + i)
            if even is None
            else even
            for i, even in enumerate(self._even_tables)
        ]
        # A concatenation of nothing, where no sun shines on any film, is an error of Dr.Jit.
        return tables[0] if len(tables) == 1 or not len(self.suns) else dr.concat(tables)

    def without_peaks(self, to_suns: mi.Float) -> tuple[mi.Float, tuple[Peaks, ...]]:
        """Take the peaks of films that are not exposed out of the table of `answer_to_suns`."""
        if not len(self.suns) or all(mount.exposed for mount in self.mounts):
            return to_suns, ()
        suns, start, tables, peaks = flat_indices(self.suns), 0, [], []
        for i, mount in enumerate(self.mounts):
            entries = dr.arange(mi.UInt32, mount.rows * len(self.suns))
            table = dr.gather(mi.Float, to_suns, entries + dr.opaque(mi.UInt32, start))
            start += dr.width(entries)
            if not mount.exposed:
                table, taken = take_out(mount, i, table, suns)
                peaks += [] if taken is None else [taken]
            tables.append(table)
        return dr.concat(tables), tuple(peaks)

    def first_sky_rows(self) -> np.ndarray:
        """First row of every patch in the table of the sky, and last the number of rows.

        Patches of an exposed mount share their rows: all have the same view.
        """
        owner = self.patches.owner
        exposed, rows = np.array([(mount.exposed, mount.rows) for mount in self.mounts]).T[:, owner]
        shared = (exposed > 0) & np.r_[False, owner[1:] == owner[:-1]]
        end = np.cumsum(np.where(shared, 0, rows))
        return np.append(end - rows, end[-1])

    def answer_to_sky(self, subdivision: int | None, samples: int, seed: int) -> mi.TensorXf:
        """Estimate `LitFilms.to_sky`, shape (row, bin), by `samples` directions for every cell.

        Narrower patches share the directions of a wide one; a film of few cells takes more.
        """
        first = self.first_sky_rows()
        if not subdivision:
            return dr.zeros(mi.TensorXf, (int(first[-1]), 0))
        tables = []
        for patch in np.unique(first[:-1], return_index=True)[1]:
            owner, key = self.patches.owner[patch], seed + 7919 * int(patch)
            least = -(-LEAST_DIRECTIONS // self.mounts[owner].rows)
            own = max(least, samples // self.fineness[owner] ** 2)
            of_patch = self.patches, self.mounts[owner], int(patch)
            tables.append(sky_answer(self.scene, *of_patch, subdivision, own, key))
        return mi.TensorXf(dr.concat(tables), (int(first[-1]), len(Patches(subdivision))))

    def rows(self, patch: mi.UInt32, d: mi.Vector3f, front: mi.Bool) -> tuple[mi.UInt32, mi.Bool]:
        """Row within the mount of light that a patch sends along −d, and whether it exists."""
        owner = dr.gather(mi.UInt32, flat_indices(self.patches.owner), patch)
        row, known = mi.UInt32(0), mi.Bool(False)
        for i, mount in enumerate(self.mounts):
            mine = owner == i
            cell = mount.bsdf.out_cell(mount.turn.to_local(-d))
            row = dr.select(mine, cell + dr.select(front, 0, mount.bsdf.out_cells), row)
            known |= mine & (front | (len(mount.sides) > 1))
        return row, known

    def looked(
        self, p: mi.Float, n: mi.Float, *, rays: int, seed: int,
        numbers: mi.UInt32 | None = None, within: Within = None,
    ) -> Looked:  # fmt: skip
        """Draw directions from receivers to the films; parameters as for `looks`."""
        directions = looks(
            self.scene, self.patches, p, n, rays=rays, seed=seed, numbers=numbers, within=within
        )
        return self.looked_along(directions, dr.width(p) // 3, rays)

    def looked_along(self, directions: Sequence[PaneLook], receivers: int, rays: int) -> Looked:
        """Outgoing cells that receivers meet along directions, so many of each kind from one."""
        every = []
        for look in directions:
            row, known = self.rows(look.patch, look.d, look.front)
            seen = (look.weight > 0) & known
            every.append((seen, look.row, look.patch, row, dr.pi * look.weight))
        dr.eval(every)  # in one launch: each column alone would trace the rays anew
        kinds = []
        for seen, *columns in every:
            if dr.width(at := dr.compress(seen)):
                kinds.append(Directions(*(dr.gather(type(x), x, at) for x in columns)))
                dr.eval(*kinds[-1])
        return Looked(receivers, rays, tuple(kinds))

    def even_rows(self, looked: Looked) -> tuple[EvenRows, ...]:
        """Find the cells that receivers see in films whose light is best told by a product.

        These films are exposed, and directions meet few of their cells.
        """
        films = []
        for i, mount in enumerate(self.mounts):
            if not mount.exposed:
                continue
            seen = looked.of(self.patches.owner == i)
            rays = sum(dr.width(kind.row) for kind in seen.kinds)
            rows = seen.rows_met(mount.rows)
            if rays and dr.width(rows) * seen.receivers <= FEW_ROWS * rays:
                films.append(EvenRows(i, rows))
        return tuple(films)

    def others(self, even: Sequence[EvenRows]) -> np.ndarray:
        """Patches of all other films, a mask (patch,)."""
        return ~np.isin(self.patches.owner, [film.mount for film in even])

    def weights(self, looked: Looked, even: EvenRows) -> mi.TensorXf:
        """Weights [sr] of the cells of an exposed film for receivers, shape (receiver, cell)."""
        of_mount = looked.of(self.patches.owner == even.mount)
        return of_mount.by_row(even.rows, self.mounts[even.mount].rows)

    def radiance_of_sky(self, even: EvenRows, lit: LitFilms) -> mi.TensorXf:
        """Radiance of the cells of an exposed film by sky and ground, shape (cell, bin)."""
        first, bins = self.first_sky_rows()[self._first_patch(even)], lit.to_sky.shape[1]
        return _of_rows(lit.to_sky.array, even.rows, int(first), bins)

    def sunlight(self, even: EvenRows, every: Sequence[LitFilms]) -> SunCells | SunRadiance:
        """Light of the suns, of which there are some, on an exposed film in some replicates."""
        shone = [self._shone_on(even, lit) for lit in every]
        answer = self.even_answers[even.mount]
        if answer is not None:
            f = _of_rows(answer.f.array, even.rows, 0, answer.f.shape[1])
            return SunCells(f, answer, dr.concat([D.array for D in shone]))
        before, some = sum(mount.rows for mount in self.mounts[: even.mount]), len(self.suns)
        tables = (_of_rows(lit.to_suns, even.rows, before, some) for lit in every)
        radiance = rows_of([f * D for f, D in zip(tables, shone, strict=True)])
        return SunRadiance(radiance, len(every))

    def _first_patch(self, even: EvenRows) -> int:
        return int(np.argmax(self.patches.owner == even.mount))

    def _shone_on(self, even: EvenRows, lit: LitFilms) -> mi.TensorXf:
        """D [sr] of an exposed film, all of which is lit alike, shape (lit sun,)."""
        first, some = self._first_patch(even), len(self.suns)
        count = int((self.patches.owner == even.mount).sum())
        of_patches = mi.TensorXf(self._shone(lit), (len(self.patches), some))
        return dr.mean(of_patches[first : first + count], axis=0)

    def of_all_suns(self, values: mi.TensorXf, n_suns: int) -> mi.TensorXf:
        """Values (row, lit sun) with zeros for the suns that do not shine on a film."""
        rows, some = values.shape
        if some == n_suns:
            return values
        if not rows * some:
            return dr.zeros(mi.TensorXf, (rows, n_suns))
        row, sun = row_and_column(dr.arange(mi.UInt32, rows * n_suns), n_suns)
        place = np.full(n_suns, some, np.uint32)
        place[self.suns] = np.arange(some)
        at, few = dr.gather(mi.UInt32, flat_indices(place), sun), dr.opaque(mi.UInt32, some)
        return mi.TensorXf(
            dr.gather(mi.Float, values.array, row * few + at, at < few), (rows, n_suns)
        )

    def sent(
        self, looked: Looked, lit: LitFilms, without: tuple[EvenRows, ...] = ()
    ) -> tuple[mi.TensorXf, mi.TensorXf]:
        """Irradiance D [sr] of receivers by way of the films: (receiver, bin), (receiver, sun).

        Films `without` their light, as from `even_rows`, are left to the caller.
        """
        count, n_suns, bins = looked.receivers, lit.faces.shape[1], lit.to_sky.shape[1]
        by_sky, by_sun = (dr.zeros(mi.TensorXf, (count, n)) for n in (bins, len(self.suns)))
        even = () if without else self.even_rows(looked)
        for film in even:
            W = self.weights(looked, film)
            if bins:
                by_sky = by_sky + W @ self.radiance_of_sky(film, lit)
            if len(self.suns):
                suns = self.sunlight(film, [lit])
                by_sun = by_sun + suns.sent(suns.gathered(W))
        apart = self.others(even or without)
        if apart.any():
            of_sky, of_sun = self._summed(looked.of(apart), lit)
            by_sky, by_sun = by_sky + of_sky, by_sun + of_sun
        dr.eval(by_sky, by_sun)
        return by_sky, self.of_all_suns(by_sun, n_suns)

    def _shone(self, lit: LitFilms) -> mi.Float:
        """D [sr] of both faces of every patch, flat (patch, lit sun)."""
        columns, faces = dr.opaque(mi.UInt32, lit.faces.shape[1]), lit.faces.array
        at = dr.arange(mi.UInt32, len(self.patches) * len(self.suns))
        patch, shining = row_and_column(at, len(self.suns))
        front = 2 * patch * columns + dr.gather(mi.UInt32, flat_indices(self.suns), shining)
        return dr.gather(mi.Float, faces, front) + dr.gather(mi.Float, faces, front + columns)

    def _summed(self, looked: Looked, lit: LitFilms) -> tuple[mi.TensorXf, mi.TensorXf]:
        """Sum over the directions to any patches: (receiver, bin), (receiver, lit sun)."""
        count, some, bins = looked.receivers, len(self.suns), lit.to_sky.shape[1]
        first_sky = flat_indices(self.first_sky_rows())
        first_of_mount = np.cumsum([0, *(m.rows for m in self.mounts)])
        first_sun = flat_indices(first_of_mount[self.patches.owner])
        shone, to_suns = mi.Float(0), mi.Float(0)
        if some:
            shone, to_suns = (widened(table, some) for table in (self._shone(lit), lit.to_suns))
        to_sky = widened(lit.to_sky.array, bins) if bins else mi.Float(0)
        by_sun, by_sky = dr.zeros(mi.Float, count * some), dr.zeros(mi.Float, count * bins)
        for kind in looked.kinds:
            first = first_of_rows(kind.receiver, count)
            sun_row = kind.row + dr.gather(mi.UInt32, first_sun, kind.patch)
            sky_row = kind.row + dr.gather(mi.UInt32, first_sky, kind.patch)
            dr.eval(sun_row, sky_row)
            w, patch = kind.weight, kind.patch
            if some:
                by_sun += summed(first, w, sun_row, to_suns, patch, shone, some)
            if bins:
                by_sky += summed(first, w, sky_row, to_sky, None, None, bins)
            dr.eval(by_sun, by_sky)
        return mi.TensorXf(by_sky, (count, bins)), mi.TensorXf(by_sun, (count, some))


def _of_rows(table: mi.Float, rows: mi.UInt32, first: int, columns: int) -> mi.TensorXf:
    """Some rows of a flat table (row, column), counted from a first one."""
    count = dr.width(rows)
    if not columns:
        return dr.zeros(mi.TensorXf, (count, 0))
    line, column = row_and_column(dr.arange(mi.UInt32, count * columns), columns)
    row = dr.gather(mi.UInt32, rows, line) + dr.opaque(mi.UInt32, first)
    values = dr.gather(mi.Float, table, row * dr.opaque(mi.UInt32, columns) + column)
    return mi.TensorXf(values, (count, columns))
