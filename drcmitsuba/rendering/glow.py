"""Panes that scatter, as they glow: films by their BSDF, diffusing panes evenly.

The radiance of all panes is a table with one entry for each outgoing cell of every patch of the
films, and one for each face of the diffusing panes. What is seen of a pane, by the eye or from a
surface, is an entry of this table and a weight; the table follows from the hour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.eye.openings import SeenOpenings
from drcmitsuba.model.materials import DiffuserMaterial
from drcmitsuba.model.model import areas
from drcmitsuba.rendering.facade_scenes import looks_of
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.scene.scene import Scene, ScenePart
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.films.films import Films
from drcmitsuba.transport.films.peaks import Peaks, take_out
from drcmitsuba.transport.light.irradiance import under
from drcmitsuba.transport.panes.patches import PanePatches
from drcmitsuba.transport.panes.transfer import PaneLook, looks

NEAR = 2e-3
"""Distance within which a point is on a pane [m]."""
PATCH, MOST_PATCHES = 0.06, 1024
"""Width of patches of panes of components [m], and their largest number."""


@dataclass(frozen=True)
class GlowTable:
    """Table of the panes' radiance: its layout."""

    scene: Scene
    films: Films | None
    patches: PanePatches | None
    """Patches of the panes that scatter evenly."""
    of_components: PanePatches | None = None
    """Patches of panes of components that scatter evenly, as at the end of a light pipe."""

    @classmethod
    def of(cls, base: Deposit) -> GlowTable:
        """Table of the panes of a deposit."""
        every = [part.quads for part in scattering_of_components(base.scene)]
        quads, own = [each[areas(each) > 0] for each in every], None
        if 0 < sum(map(len, quads)) <= MOST_PATCHES:
            width = max(PATCH, np.sqrt(sum(areas(each).sum() for each in quads) / MOST_PATCHES))
            own = PanePatches.of(quads, float(width))
        return cls(base.scene, base.films, base.patches, own)

    @property
    def first(self) -> np.ndarray:
        """First entry of each patch of the films, and last their number, shape (patch + 1,)."""
        if self.films is None:
            return np.zeros(1, int)
        rows = np.array([m.rows for m in self.films.mounts])[self.films.patches.owner]
        return np.concatenate([[0], np.cumsum(rows)])

    def __len__(self) -> int:
        """Count the entries."""
        return int(self.first[-1]) + self.faces[0] + self.faces[1]

    @property
    def faces(self) -> tuple[int, int]:
        """Number of faces of the room's diffusing panes, and of those of components."""
        room, own = (0 if p is None else 2 * len(p) for p in (self.patches, self.of_components))
        return room, own

    @property
    def _kinds(self) -> list[tuple[str, PanePatches, np.ndarray]]:
        """Patches of each kind of panes, and the number of entries of each patch."""
        kinds = []
        if self.films is not None:
            kinds.append(("films", self.films.patches, np.diff(self.first)))
        if self.patches is not None:
            kinds.append(("faces", self.patches, np.full(len(self.patches), 2)))
        if self.of_components is not None:
            own = self.of_components
            kinds.append(("components", own, np.full(len(own), 2)))
        return kinds

    def opening_of_entries(self, openings: SeenOpenings) -> np.ndarray:
        """Opening in which the pane of every entry stands, `NO_OPENING` for none, int, (entry,)."""
        each = [
            np.repeat(openings.at(patches.middle, patches.normal), entries)
            for _, patches, entries in self._kinds
        ]
        return np.concatenate([np.zeros(0, int), *each])

    def entries_in(self, other: GlowTable) -> np.ndarray:
        """Entry of another table for the same patch and direction, −1 for none, int, (entry,).

        There is none where another film, of other cells, stands at the place of a patch.
        """
        known, out = {place: (first, count) for place, first, count in other._places()}, []
        for place, _, count in self._places():
            first, there = known.get(place, (0, 0))
            out.append(first + np.arange(count) if there == count else np.full(count, -1))
        return np.concatenate([np.zeros(0, int), *out])

    def _places(self) -> Iterator[tuple[tuple[Any, ...], int, int]]:
        """Kind and middle [mm] of each patch, its first entry, and the number of its entries."""
        first = 0
        for kind, patches, entries in self._kinds:
            middle = np.rint(1000 * patches.middle).astype(int).tolist()
            for place, count in zip(middle, entries.tolist(), strict=True):
                yield (kind, *place), first, count
                first += count

    def _of_film(
        self, patch: mi.UInt32, d: mi.Vector3f, front: mi.Bool
    ) -> tuple[mi.UInt32, mi.Bool]:
        """Entry of the light that a patch of a film sends along −d, and whether there is one."""
        assert self.films is not None
        row, known = self.films.rows(patch, d, front)
        return dr.gather(mi.UInt32, flat_indices(self.first), patch) + row, known

    def _of_face(self, patch: mi.UInt32, front: mi.Bool, before: int = 0) -> mi.UInt32:
        """Entry of a face of a diffusing pane, with so many faces `before` its kind."""
        first = dr.opaque(mi.UInt32, int(self.first[-1]) + before)
        return first + 2 * patch + dr.select(front, mi.UInt32(0), 1)

    def seen(self, p: mi.Point3f, d: mi.Vector3f, weight: mi.Float) -> tuple[mi.UInt32, mi.Float]:
        """Entries that rays along d meet at p, and their weight; 0 where no pane glows."""
        at, met = dr.zeros(mi.UInt32, dr.width(p)), dr.full(mi.Bool, False, dr.width(p))
        nearest = mi.Float(2 * NEAR)
        ray = mi.Ray3f(p - NEAR * d, d, 2 * NEAR, 0, [])
        before = 0
        for panes in (self.films, self.patches, self.of_components):
            if panes is None:
                continue
            patches = panes.patches if isinstance(panes, Films) else panes
            hit = patches.scene.ray_intersect_preliminary(ray)
            closer = hit.is_valid() & (dr.abs(hit.t - NEAR) < nearest)
            patch = dr.select(closer, hit.prim_index // 2, 0)
            front = dr.dot(dr.gather(mi.Normal3f, flat(patches.normal), patch), d) < 0
            if isinstance(panes, Films):
                entry, known = self._of_film(patch, d, front)
            else:
                entry, known = self._of_face(patch, front, before), mi.Bool(True)
                before += 2 * len(panes)
            at, met = dr.select(closer, entry, at), dr.select(closer, known, met)
            nearest = dr.select(closer, dr.abs(hit.t - NEAR), nearest)
        return dr.select(met, at, 0), dr.select(met, weight, 0)

    def looked(
        self, p: mi.Point3f, n: mi.Normal3f, number: mi.UInt32, *, rays: int, seed: int
    ) -> tuple[mi.UInt32, mi.Float]:
        """Entries that points see, and their irradiance per radiance of the entry [sr].

        Returns
        -------
        at : mi.UInt32, shape (column · point · rays,)
        weight : mi.Float
            As many columns as `columns`.
        """
        points, facing, at, weight = dr.ravel(p), dr.ravel(mi.Vector3f(n)), [], []
        kind: dict[str, Any] = {"rays": rays, "seed": seed, "numbers": number}
        for panes in (self.films, self.patches):
            if panes is None:
                continue
            patches = panes.patches if isinstance(panes, Films) else panes
            for look in looks(self.scene, patches, points, facing, **kind):
                entry, known = self._entry(panes, look)
                at.append(dr.select(known, entry, 0))
                weight.append(dr.select(known, dr.pi * look.weight, 0))
                dr.eval(at[-1], weight[-1])
        return dr.concat(at), dr.concat(weight)

    def _entry(self, panes: Films | PanePatches, look: PaneLook) -> tuple[mi.UInt32, mi.Bool]:
        if isinstance(panes, Films):
            return self._of_film(look.patch, look.d, look.front)
        return self._of_face(look.patch, look.front), mi.Bool(True)

    @property
    def columns(self) -> int:
        """Number of entries that a ray of `looked` gives."""
        return looks_of(self.scene)

    def answer(self, lit: Deposit, seed: int) -> mi.Float:
        """BSDF of the films from the sun of a deposit into all rows of their mounts [1/sr]."""
        if lit.films is None or not len(lit.films.suns):
            return mi.Float()
        return lit.films.answer_to_suns(seed)

    def split(self, answer: mi.Float) -> tuple[mi.Float, tuple[Peaks, ...]]:
        """Take the narrow peaks out of an answer to one sun; what is left, and the peaks."""
        if self.films is None or not dr.width(answer):
            return answer, ()
        first, rest, peaks = 0, [], []
        for i, mount in enumerate(self.films.mounts):
            rows = dr.arange(mi.UInt32, mount.rows) + dr.opaque(mi.UInt32, first)
            left, taken = take_out(mount, i, dr.gather(mi.Float, answer, rows), mi.UInt32(0))
            first += mount.rows
            rest.append(left)
            peaks += [] if taken is None else [taken]
        return dr.concat(rest), tuple(peaks)

    def radiance(self, lit: Deposit, L_sky: np.ndarray, L_sun: float, answer: mi.Float) -> mi.Float:
        """Radiance of all entries by a deposit, of the sky's bins and of one sun or none.

        Parameters
        ----------
        lit : Deposit
            Deposit after `lit`.
        L_sky : np.ndarray, shape (bin,)
            Luminances of ground and sky [cd/m²]; empty for a deposit without the sky.
        L_sun : float
            Luminance of the sun [cd/m²].
        answer : mi.Float, shape (row,)
            BSDF from the sun, see `answer`; empty where no sun shines on a film.

        Returns
        -------
        mi.Float, shape (entry,)
            [cd/m²].
        """
        parts = []
        if self.films is not None:
            parts.append(self._of_films(lit, L_sky, L_sun, answer))
        if self.patches is not None:
            parts.append(self._of_faces(lit, L_sky, L_sun))
        if self.of_components is not None:
            parts.append(dr.zeros(mi.Float, self.faces[1]))
        out = dr.concat(parts)
        dr.eval(out)
        return out

    def by_bin(self, lit: Deposit) -> mi.TensorXf:
        """Radiance of all entries per radiance of the sky's bins, shape (entry, bin)."""
        bins, parts = lit.bins[0], []
        stride = dr.opaque(mi.UInt32, bins)
        if self.films is not None:
            assert lit.on_films is not None
            entry = dr.arange(mi.UInt32, int(self.first[-1]) * bins)
            row = dr.gather(mi.UInt32, self._rows_of(self.films.first_sky_rows()), entry // stride)
            parts.append(
                dr.gather(mi.Float, lit.on_films.to_sky.array, row * stride + entry % stride)
            )
        if self.patches is not None:
            assert lit.faces is not None
            parts.append(self._even(lit.faces.sky).array)
        if self.of_components is not None:
            parts.append(dr.zeros(mi.Float, self.faces[1] * bins))
        return mi.TensorXf(dr.concat(parts), (len(self), bins))

    def further(self, E: mi.TensorXf) -> mi.TensorXf:
        """Radiance of all entries by further light on the faces of diffusing panes.

        `E` has the faces of the room's panes, then those of components, (face, column); the result
        has as many columns.
        """
        return from_row(int(self.first[-1]), len(self), self._even(E))

    def _rows_of(self, first: np.ndarray) -> mi.UInt32:
        """Rows of the films' entries in a table in which patches begin at rows `first`."""
        count = np.diff(self.first)
        patch = flat_indices(np.repeat(np.arange(len(count)), count))
        row = dr.arange(mi.UInt32, int(self.first[-1]))
        row -= dr.gather(mi.UInt32, flat_indices(self.first), patch)
        return dr.gather(mi.UInt32, flat_indices(first), patch) + row

    def _of_films(
        self, lit: Deposit, L_sky: np.ndarray, L_sun: float, answer: mi.Float
    ) -> mi.Float:
        assert self.films is not None
        assert lit.films is not None
        assert lit.on_films is not None
        films, on_films = lit.films, lit.on_films
        out = dr.zeros(mi.Float, int(self.first[-1]))
        if len(L_sky):
            glow = under(on_films.to_sky, L_sky).array
            out += dr.gather(mi.Float, glow, self._rows_of(films.first_sky_rows()))
        if dr.width(answer):
            of_mount = np.cumsum([0, *(m.rows for m in films.mounts)])[films.patches.owner]
            f = dr.gather(mi.Float, answer, self._rows_of(of_mount))
            count = np.diff(self.first)
            patch = flat_indices(np.repeat(np.arange(len(count)), count))
            front, back = (
                dr.gather(mi.Float, on_films.faces.array, 2 * patch + side) for side in (0, 1)
            )
            out += f * (front + back) * dr.opaque(mi.Float, L_sun)
        return out

    @cached_property
    def _optics(self) -> tuple[mi.Float, mi.Float]:
        """Transmittance and reflectance of diffusing panes' faces, those of the room first."""
        kinds = (
            (self.patches, self.scene.scattering),
            (self.of_components, scattering_of_components(self.scene)),
        )
        through, back = [np.zeros(0)], [np.zeros(0)]
        for patches, parts in kinds:
            optics: list[Any] = [part.material for part in parts]
            owner = np.zeros(0, int) if patches is None else patches.owner
            through.append(np.repeat([optics[i].scattered for i in owner], 2))
            back.append(np.ravel([optics[i].sides for i in owner]))
        return flat(np.concatenate(through)), flat(np.concatenate(back))

    def _even(self, E: mi.TensorXf) -> mi.TensorXf:
        """Radiance of the first faces by their irradiance (face, column), scattered evenly."""
        faces, columns = E.shape
        stride = dr.opaque(mi.UInt32, columns)
        entry = dr.arange(mi.UInt32, faces * columns)
        face, column = entry // stride, entry % stride
        far, near = (dr.gather(mi.Float, E.array, f * stride + column) for f in (face ^ 1, face))
        T, R = (dr.gather(mi.Float, share, face) for share in self._optics)
        return mi.TensorXf((T * far + R * near) * dr.inv_pi, (faces, columns))

    def _of_faces(self, lit: Deposit, L_sky: np.ndarray, L_sun: float) -> mi.Float:
        assert self.patches is not None
        assert lit.faces is not None
        E = dr.zeros(mi.Float, 2 * len(self.patches))
        for D, L in zip(lit.faces, (L_sky, np.full(len(lit.suns), L_sun)), strict=True):
            if len(L):
                E += under(D, L).array
        return self._even(mi.TensorXf(E, (dr.width(E), 1))).array


def scattering_of_components(scene: Scene) -> tuple[ScenePart, ...]:
    """Panes of components that scatter evenly, of which no deposit knows the light."""
    return tuple(p for p in scene.parts if p.component and isinstance(p.material, DiffuserMaterial))


def from_row(first: int, rows: int, values: mi.TensorXf) -> mi.TensorXf:
    """Matrix of so many rows, 0 before the `first` one of some values."""
    columns = values.shape[1]
    out = dr.zeros(mi.Float, rows * columns)
    at = dr.arange(mi.UInt32, dr.width(values.array)) + dr.opaque(mi.UInt32, first * columns)
    dr.scatter(out, values.array, at)
    return mi.TensorXf(out, (rows, columns))
