"""Light of the photons of a replicate: D of cells and sensors, and where their flux went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, row_and_column
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.photons.fluxes import FATES, FluxSums
from drcmitsuba.transport.photons.receivers import CellAreas

_NONE = 0xFFFFFFFF


@dataclass(frozen=True)
class FluxLedger:
    """Flux of photons by fate, per unit radiance of all bins [m² sr].

    emitted + roulette = landed + absorbed + escaped + others + lost, to rounding; `roulette` is 0
    in the mean.
    """

    emitted: float = 0.0
    """Flux through the ports."""
    landed: float = 0.0
    """Flux onto diffuse surfaces."""
    absorbed: float = 0.0
    """Flux into mirrors, panes and solids."""
    escaped: float = 0.0
    """Flux to the outside."""
    others: float = 0.0
    """Flux on chains that other estimators, or other ports, count."""
    lost: float = 0.0
    """Flux still on its way after the largest number of surfaces."""
    roulette: float = 0.0
    """Flux added to survivors of the roulette, less the flux of the photons that it ended."""
    photons: int = 0
    segments: int = 0
    """Number of photons, and of their flights from surface to surface."""

    def plus(self, other: FluxLedger) -> FluxLedger:
        """Sum of two ledgers."""
        names = (f.name for f in fields(self))
        return replace(self, **{n: getattr(self, n) + getattr(other, n) for n in names})

    @classmethod
    def of(cls, fates: np.ndarray) -> FluxLedger:
        """Sum `FATES` and `COUNTS` over bins, shape (fate, bin)."""
        flux, counts = np.split(fates.sum(axis=1), [len(FATES)])
        return cls(*flux.tolist(), *counts.round().astype(int).tolist())


class LitEntries(NamedTuple):
    """Entries of a matrix (row, bin) that are above 0: few, where bins have few photons."""

    at: mi.UInt32
    """Indices of entries, row · bins + bin, each once."""
    value: mi.Float
    """Their values, in the order of `at`."""
    shape: tuple[int, int]

    @classmethod
    def of(cls, sums: mi.Float64, areas: mi.Float, bins: int, half: int) -> LitEntries:
        """Divide the flux in a half of sums by the areas of its rows."""
        rows = dr.width(areas)
        begin, at = dr.opaque(mi.UInt32, half * rows * bins), mi.UInt32()
        if rows * bins:
            entry = begin + dr.arange(mi.UInt32, rows * bins)
            at = dr.compress(dr.gather(mi.Float64, sums, entry) > 0)
        if not dr.width(at):
            return cls(at, mi.Float(), (rows, bins))
        row, _ = row_and_column(at, bins)
        value = mi.Float(dr.gather(mi.Float64, sums, at + begin)) / dr.gather(mi.Float, areas, row)
        dr.eval(value)  # a pending number would keep the sums
        return cls(at, value, (rows, bins))

    @property
    def nbytes(self) -> int:
        """Size of the entries and of their indices [bytes]."""
        return 8 * dr.width(self.at)

    def of_bins(self, place: np.ndarray, count: int) -> LitEntries:
        """Entries of a matrix of `count` bins, with the new place of each bin, −1 for none."""
        rows, bins = self.shape
        if not dr.width(self.at):
            return LitEntries(self.at, self.value, (rows, count))
        row, bin = row_and_column(self.at, bins)
        to = dr.gather(mi.Int32, mi.Int32(place.astype(np.int32)), bin)
        some = dr.compress(to >= 0)
        if not dr.width(some):
            return LitEntries(mi.UInt32(), mi.Float(), (rows, count))
        at = dr.gather(mi.UInt32, row * dr.opaque(mi.UInt32, count) + mi.UInt32(to), some)
        value = dr.gather(mi.Float, self.value, some)
        dr.eval(at, value)
        return LitEntries(at, value, (rows, count))


def dense(parts: Sequence[LitEntries], here: slice | None = None) -> mi.TensorXf:
    """Sum of matrices, or some rows `here` of it."""
    rows, bins = parts[0].shape
    here = slice(0, rows) if here is None else here
    size = (here.stop - here.start) * bins
    out = dr.zeros(mi.Float, size)
    first, last = (dr.opaque(mi.UInt32, row * bins) for row in (here.start, here.stop))
    for at, value, _ in parts:
        if size and dr.width(at):
            inside = (at >= first) & (at < last)
            dr.scatter_add(out, value, at - first, inside, mode=dr.ReduceMode.Direct)
    return mi.TensorXf(out, (here.stop - here.start, bins))


class PhotonLight(NamedTuple):
    """D of photons of one kind of bins [sr], as sums of matrices."""

    cells: tuple[LitEntries, ...]
    """D of the rows of `CellAreas`."""
    sensors: tuple[LitEntries, ...]
    mirrored: tuple[LitEntries, ...]
    """D of the sensors, and the purely mirrored (or refracted) part of it."""
    inner: tuple[LitEntries, ...]
    """D of the middle quarter of the sensors' squares."""

    @classmethod
    def of(
        cls, sums: FluxSums, areas: mi.Float, edges: np.ndarray, bins: int, half: int
    ) -> PhotonLight:
        """Divide the flux in a half of sums by areas [m²], and by those of squares."""
        square, middle = flat(edges**2), flat(edges**2 / 4)
        sizes = (areas, square, square, middle)
        return cls(
            *((LitEntries.of(s, a, bins, half),) for s, a in zip(sums[:4], sizes, strict=True))
        )

    def plus(self, other: PhotonLight) -> PhotonLight:
        """Sum of two lights."""
        return PhotonLight(*(a + b for a, b in zip(self, other, strict=True)))

    def of_bins(self, place: np.ndarray, count: int) -> PhotonLight:
        """Light of `count` bins, with the new place of each bin, −1 for none."""
        return PhotonLight(*(tuple(one.of_bins(place, count) for one in part) for part in self))


@dataclass(frozen=True)
class CommonLight:
    """Photons of one kind of bins until they met a pane that may change.

    Other states of the façade have the same light until then.
    """

    light: PhotonLight
    """D of these photons [sr]."""
    met: Mapping[str, np.ndarray]
    """Photons that met a pane, by the name of their ports: source · count + index, uint32, shape
    (photon,)."""
    fates: Mapping[str, np.ndarray]
    """`FATES` and `COUNTS` of all others, by the name of their ports, shape (fate, bin)."""
    count: int
    """Number of photons of a source."""

    @property
    def nbytes(self) -> int:
        """Size of the light and of the list of photons [bytes]."""
        lit = sum(one.nbytes for part in self.light for one in part)
        return lit + sum(photons.nbytes for photons in self.met.values())

    def of_bins(self, bins: np.ndarray) -> CommonLight:
        """Take the photons of some suns, which are sources with a bin each."""
        place = np.full(self.light.cells[0].shape[1], -1)
        place[bins] = np.arange(len(bins))
        met = {}
        for name, photons in self.met.items():
            at = place[photons // self.count]
            number = at * self.count + photons % self.count
            met[name] = number[at >= 0].astype(np.uint32)
        fates = {name: of_port[:, bins] for name, of_port in self.fates.items()}
        return CommonLight(self.light.of_bins(place, len(bins)), met, fates, self.count)


@dataclass(frozen=True)
class Landed:
    """Light of all photons of a replicate."""

    areas: CellAreas
    lights: tuple[PhotonLight, PhotonLight]
    """D by ground and sky patches, and by suns [sr]."""
    ledgers: dict[str, FluxLedger]
    """Flux by "NAME sky" and "NAME sun" for each component; the panes have an empty name."""
    common: tuple[CommonLight, CommonLight] | None = None
    """Light that other states of the façade share, by ground and sky and by suns; None where no
    panes are told apart."""

    @property
    def cells(self) -> Irradiance:
        """D of the cells [sr], rows as in `areas`."""
        return Irradiance(*(dense(light.cells) for light in self.lights))

    def sensors(self, here: slice | None = None) -> Irradiance:
        """D of the sensors [sr], of all or of those that are `here`."""
        return Irradiance(*(dense(light.sensors, here) for light in self.lights))

    def mirrored(self, here: slice | None = None) -> Irradiance:
        """Part of D of the sensors that is purely mirrored or refracted [sr]."""
        return Irradiance(*(dense(light.mirrored, here) for light in self.lights))

    @property
    def smear(self) -> np.ndarray:
        """Error of D of the sensors by the size of the squares, (2, sensor) [sr].

        It is summed over ground and sky patches, and over all suns. Where D is smooth the error of
        a square of edge h is c·h²: D of the whole square exceeds D of its inner quarter by ¾ c·h².
        """
        return np.array(
            [
                4 / 3 * (dense(light.sensors).numpy() - dense(light.inner).numpy()).sum(axis=1)
                for light in self.lights
            ]
        )

    def on(self, key: mi.UInt32) -> Irradiance:
        """D of the cells with the given keys, each once; 0 where no photon can land."""
        row, known = self.areas.at(key)
        place, count = dr.full(mi.UInt32, _NONE, len(self.areas)), dr.width(key)
        if count and len(self.areas):
            dr.scatter(place, dr.arange(mi.UInt32, count), row, known)

        def of(parts: Sequence[LitEntries]) -> mi.TensorXf:
            bins = parts[0].shape[1]
            out = dr.zeros(mi.Float, count * bins)
            for at, value, _ in parts:
                if count and dr.width(at):
                    row, bin = row_and_column(at, bins)
                    to = dr.gather(mi.UInt32, place, row)
                    entry = to * dr.opaque(mi.UInt32, bins) + bin
                    dr.scatter_add(out, value, entry, to != _NONE, mode=dr.ReduceMode.Direct)
            return mi.TensorXf(out, (count, bins))

        return Irradiance(*(of(light.cells) for light in self.lights))
