"""Light of scattering panes on receivers, in several replicates: weights of parts and light."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import Key
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.films.answers import SunCells, SunRadiance
from drcmitsuba.transport.films.films import EvenRows, Films
from drcmitsuba.transport.films.looks import Looked
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.light.lit_cells import LitCells
from drcmitsuba.transport.light.products import by_replicate, rows_of
from drcmitsuba.transport.rays.openings import Within


class SunsOnFilm(NamedTuple):
    """Light of the suns on an exposed film."""

    films: Films
    suns: SunCells | SunRadiance
    bins: tuple[int, int]
    """Number of bins of the sky, and of suns."""

    def through(self, weights: mi.TensorXf, replicates: int) -> Irradiance:
        """Light that receivers get, as `Irradiance.through`."""
        sky = dr.zeros(mi.TensorXf, (weights.shape[0], self.bins[0]))
        return Irradiance(sky, self.films.of_all_suns(self.suns.sent(weights), self.bins[1]))

    def by_bin(self, weights: np.ndarray) -> Iterator[np.ndarray]:
        """Yield sums by bin over the replicates of each result, as `Irradiance.by_bin`."""
        results, each, parts, receivers = weights.shape
        W = np.ascontiguousarray(weights.swapaxes(2, 3))
        rows = mi.TensorXf(flat(W), (results * each * receivers, parts))
        sent = self.through(rows, results * each).numpy()
        every = sent.reshape(results, each, receivers, sent.shape[1])
        return (light[0].T if each == 1 else light.sum(axis=0).T for light in every)


Light = Irradiance | SunsOnFilm
"""Light of parts of panes."""


class FromPanes(NamedTuple):
    """Light that some parts of panes send: per light of a part, and the light of every part.

    A part is a face of an evenly scattering pane, or what an exposed film is told by: the incident
    cells of its BSDF, where it is even, or the outgoing ones.
    """

    cells: mi.TensorXf
    """To cells, before any diffuse reflection, shape (replicate · cell, part)."""
    indirect: mi.TensorXf | None
    """To cells by light that cells have reflected, shape (replicate · cell, part); None where
    `Transfer.followed` takes its place."""
    light: Light
    """Irradiance on faces [sr], shape (replicate · part, bin) each, or sunlight on a film."""
    reached: LitCells | None = None
    """Cells and parts with light of `cells`."""


def by_panes(
    deposits: Sequence[Deposit], p: mi.Float, n: mi.Float, key: Key, numbers: list[mi.UInt32],
    within: Within = None,
) -> tuple[Irradiance | None, list[tuple[mi.TensorXf, Light]]]:  # fmt: skip
    """Light of scattering panes on receivers, those of one replicate after those of another.

    Parameters
    ----------
    deposits : sequence of Deposit
        Deposits of the replicates.
    p, n : mi.Float
        Positions [m] and normals, three numbers each.
    key : tuple
        Stream of the random numbers, with its indices.
    numbers : list of mi.UInt32
        Numbers of the receivers in each replicate.
    within : mi.Bool or bool, optional
        Whether the receivers lie in the room, see `openings.Within`.

    Returns
    -------
    rest : Irradiance or None
        D [sr] by films whose light is no product, and by the sky through all films.
    parts : list of (K, light)
        Weights of parts of panes for the receivers, and their light, see `FromPanes`.
    """
    base, every = deposits[0], dr.concat(numbers)
    parts: list[tuple[mi.TensorXf, Light]] = []
    films, count = base.films, len(deposits)
    if films is None or base.on_films is None:
        rest = base.by_films(p, n, key, every, within)
    else:
        rest, looked = None, base.looked(p, n, key, every, within)
        even = films.even_rows(looked)
        of_films = [_by_film(deposits, films, film, looked) for film in even]
        parts = [part for _, part in of_films if part is not None]
        peaks = any(lit.on_films is not None and lit.on_films.peaks for lit in deposits)
        if peaks or looked.of(films.others(even)).kinds:
            at = (_parts(values, count) for values in (p, n))
            each = zip(deposits, looked.apart(count), *at, numbers, strict=True)
            rest = stacked(
                lit.by_looked(own, own_p, own_n, key, number, without=even)
                for lit, own, own_p, own_n, number in each
            )
        for sky, _ in of_films:
            rest = sky.plus(rest)
    if (E := stacked(one.faces for one in deposits)) is not None:
        parts.append((base.transfer(p, n, key, every, within), E))
    return rest, parts


def _by_film(
    deposits: Sequence[Deposit], films: Films, film: EvenRows, looked: Looked
) -> tuple[Irradiance, tuple[mi.TensorXf, Light] | None]:
    """Light of an exposed film on receivers: of the sky; weights of parts, and their light."""
    every = [lit.on_films for lit in deposits if lit.on_films is not None]
    W, n_suns, count = films.weights(looked, film), deposits[0].bins[1], len(every)
    to_sky = rows_of([films.radiance_of_sky(film, lit) for lit in every])
    sky = Irradiance(by_replicate(W, to_sky, count), dr.zeros(mi.TensorXf, (W.shape[0], n_suns)))
    if not len(films.suns):
        return sky, None
    suns = films.sunlight(film, every)
    return sky, (suns.gathered(W), SunsOnFilm(films, suns, (to_sky.shape[1], n_suns)))


def _parts(values: mi.Float, parts: int) -> list[mi.Float]:
    """Parts of equal length of an array."""
    size = dr.width(values) // parts
    entry = dr.arange(mi.UInt32, size)
    starts = (dr.opaque(mi.UInt32, part * size) for part in range(parts))
    out = [dr.gather(mi.Float, values, entry + start) for start in starts]
    dr.eval(out)
    return out


def stacked(parts: Iterable[Irradiance | None]) -> Irradiance | None:
    """Rows of several irradiances one after another; None where there are none."""
    every = [part for part in parts if part is not None]
    if not every:
        return None

    return Irradiance(*(rows_of(column) for column in zip(*every, strict=True)))
