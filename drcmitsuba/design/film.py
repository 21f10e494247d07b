r"""Films as design variables: their answer A to daylight as a function of few or many parameters.

The answer A [1] is the radiance that leaves a film in each outgoing cell o per unit radiance of
each bin b of ground, sky and suns,

.. math:: A_{o,b} = \int_b \bar f(\omega \to o) \cos\theta \, d\omega

with f averaged over the cell by projected solid angle. All films here are differentiable in their
parameters; `FilmYear.illuminance` turns answers into the illuminances of a year.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.redirection import concentration, redirected

from drcmitsuba.design.film_bins import FilmBins
from drcmitsuba.model.materials import BsdfMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.scene import materials

WITHIN = 4
"""Integration points of a lobe along each side of an outgoing cell and of a sky patch."""
LEAST_SPREAD = 2.0
"""Least spread [deg]: narrower lobes fall between the points; cells of depth 5 are 3° wide."""


class Film(Protocol):
    """A film for which a `FilmYear` computes illuminances."""

    def answer(self, bins: FilmBins) -> mi.TensorXf:
        """Return the leaving radiance per unit radiance of the bins, shape (cell, bin)."""


def _parameter(name: str, value: Any, low: float, high: float) -> mi.Float:
    """Value of a parameter as mi.Float, with its gradient; refused outside low … high."""
    number = mi.Float(value)
    if dr.width(number) != 1 or not low <= float(dr.detach(number)[0]) <= high:
        got = str(dr.detach(number))
        raise InputError("film", name, got, f"give one number from {low:g} to {high:g}")
    dr.make_opaque(number)  # each value of a literal would need its own kernel
    return number


@dataclass(frozen=True)
class ParametricFilm:
    """The film of the plugin `redirecting_film`: a lobe about the redirected direction.

    Parameters
    ----------
    transmittance : mi.Float or float
        Transmittance T, 0 … 1.
    redirected : mi.Float or float
        Share of the transmitted light that is in the lobe, 0 … 1; the rest leaves evenly.
    tilt : mi.Float or float
        Angle of the lobe above the mirrored direction, −90 … 90 [deg].
    spread : mi.Float or float
        Standard deviation σ of the lobe, 2 … 90 [deg].

    Raises
    ------
    InputError
        A parameter is out of its range.

    Notes
    -----
    Limits: a lobe is integrated over an outgoing cell with 16 points and over a patch of the sky
    with 16 directions, then scaled so that all cells together emit exactly the lobe's share. The
    answer does not contain reflected light.
    """

    transmittance: Any
    redirected: Any = 1.0
    tilt: Any = 0.0
    spread: Any = 10.0

    def answer(self, bins: FilmBins) -> mi.TensorXf:
        """Return the leaving radiance per unit radiance of the bins, shape (cell, bin)."""
        through = _parameter("transmittance", self.transmittance, 0, 1)
        share = _parameter("redirected", self.redirected, 0, 1)
        tilt = _parameter("tilt", self.tilt, -90, 90)
        spread = _parameter("spread", self.spread, LEAST_SPREAD, 90)
        cells, count = bins.cells, len(bins)
        arriving, leaving = bins.arriving(WITHIN, 1), bins.parts(WITHIN)
        x, y, z = (flat(c) for c in (arriving.d * [1, 1, -1]).T)
        centre = redirected(mi.Vector3f(x, y, z), tilt)
        # A lobe behind the pane is folded: its mirror image, the nearer centre, has the same lobe.
        centre.z = dr.abs(centre.z)
        kappa = concentration(spread)
        # Ordered by direction, then by cell: sums over the cells run over neighbours.
        lane = dr.arange(mi.UInt32, len(arriving.d) * cells)
        direction, cell = lane // cells, lane % cells
        mu = dr.gather(mi.Vector3f, centre, direction)
        kappa = dr.gather(mi.Float, kappa, dr.zeros(mi.UInt32, dr.width(lane)))
        points, solid_angle = flat(leaving.d), flat(leaving.solid_angle)
        lobe = mi.Float(0)
        for k in range(WITHIN**2):
            at = cell * WITHIN**2 + k
            o = dr.gather(mi.Vector3f, points, at)
            near = dr.exp(-0.5 * kappa * dr.squared_norm(o - mu))
            # Folded lobe: the squared chord to the direction with z reversed is longer by 4 z z'.
            near += near * dr.exp(-2 * kappa * o.z * mu.z)
            lobe += dr.gather(mi.Float, solid_angle, at) * near
        whole = dr.gather(mi.Float, dr.block_sum(lobe, cells), direction)
        radiance = lobe / whole * (cells / np.pi)
        radiance *= dr.gather(mi.Float, flat(arriving.weight), direction)
        into = cell * count + dr.gather(mi.UInt32, flat_indices(arriving.bin), direction)
        in_lobe = dr.zeros(mi.Float, cells * count)
        dr.scatter_add(in_lobe, radiance, into)
        even = mi.Float(np.bincount(arriving.bin, arriving.weight, count).astype(np.float32))
        even = dr.gather(mi.Float, even, dr.arange(mi.UInt32, cells * count) % count) / dr.pi
        return mi.TensorXf(through * dr.lerp(even, in_lobe, share), (cells, count))


@dataclass(frozen=True)
class MeasuredFilm:
    """A film given by its BSDF file.

    Parameters
    ----------
    file : Path
        LBNL XML: tensor tree or Klems.
    flip, turn : bool
        Mounting, as for a material of type "bsdf".

    Notes
    -----
    A straight-through peak counts as light scattered within its cells. A file is read once.
    """

    file: Path
    flip: bool = False
    turn: bool = False

    @property
    def bsdf(self) -> Any:
        """Plugin `tensor_tree` or `klems` with the film's file."""
        return _bsdf(self, mi.variant())

    @property
    def values(self) -> mi.Float:
        """Values f [1/sr] of all leaves, shape (leaf,); a copy, as a NumPy view could change it."""
        return mi.Float(self.bsdf.leaves.numpy().copy())

    def answer(self, bins: FilmBins) -> mi.TensorXf:
        """Return the leaving radiance per unit radiance of the bins, shape (cell, bin)."""
        return _answer_once(self, bins)


@lru_cache(maxsize=8)
def _bsdf(film: MeasuredFilm, variant: str) -> Any:
    """Plugin of a film, one for each variant."""
    file = Path(film.file)
    if not file.is_file():
        raise InputError("film", "file", f"no file {file}", "give a BSDF file")
    material = BsdfMaterial(
        type="bsdf", file=file, straight_through="off", flip=film.flip, turn=film.turn
    )
    return mi.load_dict(materials.bsdf(material))


@lru_cache(maxsize=4)
def _answer_once(film: MeasuredFilm, bins: FilmBins) -> mi.TensorXf:
    answer = leaves_of(film, bins).answer(film.bsdf.leaves)
    dr.eval(answer)
    return answer


@dataclass(frozen=True)
class Mix:
    """Two films side by side, in patches that are small in comparison with the room.

    Parameters
    ----------
    share : mi.Float or float
        Share of the second film, 0 … 1.
    """

    first: Film
    second: Film
    share: Any

    def answer(self, bins: FilmBins) -> mi.TensorXf:
        """Return the leaving radiance per unit radiance of the bins, shape (cell, bin)."""
        share = _parameter("share", self.share, 0, 1)
        first, second = self.first.answer(bins), self.second.answer(bins)
        return mi.TensorXf(dr.lerp(first.array, second.array, share), first.shape)


@dataclass(frozen=True)
class Leaves:
    """A measured film with other values of its leaves; the answer A is linear in these values.

    Parameters
    ----------
    values : mi.Float, shape (leaf,)
        BSDF f [1/sr], in the order of `film.values`.

    Notes
    -----
    Limits: the conservation of energy is not checked. Leaves of reflection and of light from the
    room have no influence.
    """

    film: MeasuredFilm
    values: mi.Float

    def answer(self, bins: FilmBins) -> mi.TensorXf:
        """Return the leaving radiance per unit radiance of the bins, shape (cell, bin)."""
        count = dr.width(self.film.bsdf.leaves)
        if dr.width(self.values) != count:
            got = f"{dr.width(self.values)} values"
            raise InputError("film", "values", got, f"give one for each of the {count} leaves")
        return leaves_of(self.film, bins).answer(self.values)


@dataclass(frozen=True)
class LeavesOfAnswer:
    """Leaves whose values add up to an answer A of a `shape`, cells and bins.

    Parameters
    ----------
    leaf : mi.UInt32, shape (direction · cell · point,)
        Number of the leaf from 1 on; 0 where the file has none.
    weight, bin : mi.Float and mi.UInt32, shape (direction,)
        Weight of an arriving direction, divided by the number of `points` of a cell [sr]; its bin.
    """

    leaf: mi.UInt32
    weight: mi.Float
    bin: mi.UInt32
    points: int
    shape: tuple[int, int]

    def answer(self, values: mi.Float) -> mi.TensorXf:
        """Answer A [1], shape (cell, bin), for values f [1/sr] of the leaves, shape (leaf,)."""
        cells, count = self.shape
        lane = dr.arange(mi.UInt32, dr.width(self.leaf))
        direction = lane // (cells * self.points)
        cell = lane // self.points % cells
        has_leaf = self.leaf > 0
        f = dr.gather(mi.Float, values, self.leaf - 1, has_leaf)
        f *= dr.gather(mi.Float, self.weight, direction)
        out = dr.zeros(mi.Float, cells * count)
        dr.scatter_add(out, f, cell * count + dr.gather(mi.UInt32, self.bin, direction), has_leaf)
        return mi.TensorXf(out, self.shape)


@lru_cache(maxsize=2)  # some 50 to 200 MB for a year of hours
def leaves_of(film: MeasuredFilm, bins: FilmBins) -> LeavesOfAnswer:
    """Leaves whose values add up to a film's answer; the look-up is made once for all values.

    If outgoing cells lie entirely within cells of the file, a cell has 1 point, a sky patch 64
    directions and a sun 4 on its disk; for other files the numbers are 16, 16 and 1.
    """
    bsdf = film.bsdf
    fits = bsdf.out_even and bsdf.out_cells in [1 << 2 * k for k in range(bins.depth + 1)]
    points = 1 if fits else WITHIN**2
    arriving = bins.arriving(8, 4) if fits else bins.arriving(WITHIN, 1)
    to, from_ = bins.points(points), flat(arriving.d)
    leaves, total = [], len(arriving.d) * len(to)
    si = dr.zeros(mi.SurfaceInteraction3f)
    # A horizontal pane has the world's y axis, so that local directions are those of the pane.
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(si.n)
    stride, to = dr.opaque(mi.UInt32, len(to)), flat(to)
    for start in range(0, total, SHADOW_RAYS):
        lane = dr.arange(mi.UInt32, min(SHADOW_RAYS, total - start)) + dr.opaque(mi.UInt32, start)
        si.wi = dr.gather(mi.Vector3f, to, lane % stride)
        leaves.append(bsdf.leaf(si, dr.gather(mi.Vector3f, from_, lane // stride)))
        dr.eval(leaves[-1])
    return LeavesOfAnswer(
        dr.concat(leaves), flat(arriving.weight / points), flat_indices(arriving.bin), points,
        shape=(bins.cells, len(bins)),
    )  # fmt: skip
