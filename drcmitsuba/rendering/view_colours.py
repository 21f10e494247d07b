r"""Colour of a view's light: few light paths in each band of the spectrum.

A picture's luminances :math:`L` are those of its many light paths by luminance. Bands tell its
chromaticity alone: :math:`X = L\, X'/Y'`, with the tristimulus values of the bands,

.. math:: (X', Y', Z') = \sum_k w_k L'_k, \qquad
    L'_k = S_k + A_k E' e_k, \qquad e_k = \overline{G_k / (A_k L)} \,/\, \overline{1 / L}.

`S` is what rays show without noise, the outside and the sun on surfaces; `G` what surfaces gather,
whose few rays are noisy; `A` the luminance of the surfaces per irradiance; bars are means over a
square of some pixels. So edges, textures and shadows have each pixel's own colour, and only the
colour of the light that comes from everywhere is smoothed: e, over its own luminance. Where L is
above Y', as at a window's edge whose sky the few rays have missed, the rest has the colour of the
next pixels. All bands have the same random numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import xarray as xr

from drcmitsuba.annual.spectral_year import FEWER, with_few_rays
from drcmitsuba.case.case import Case
from drcmitsuba.case.effects import Sources
from drcmitsuba.case.groups import State
from drcmitsuba.colour.bands import TRISTIMULUS, Bands
from drcmitsuba.colour.sources import SourceSpectra, sky_temperatures
from drcmitsuba.colour.tints import Tints
from drcmitsuba.picture.exr_header import BT709
from drcmitsuba.picture.picture import to_xyz
from drcmitsuba.rendering.facade_scenes import FacadeScenes, Indices
from drcmitsuba.rendering.hour import LightParts, in_parts
from drcmitsuba.rendering.outside import OutsideLuminances
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.rendering.view_by_element import ViewByElement
from drcmitsuba.rendering.view_parts import ViewPart
from drcmitsuba.runtime.lazy import module
from drcmitsuba.scene.scene import Tint
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.daylight import Daylight

images = module("scipy.ndimage")

FEWER_SAMPLES = 3
"""Factor by which a band has fewer rays from the eye."""
REPLICATES = 2
"""Number of replicates of a band."""
SQUARE = 7
"""Edge of the square over which the colour of gathered light is smoothed [pixel]."""
NEAR = 3
"""Edge of the square whose colour has light that only the picture's rays met [pixel]."""


@dataclass(frozen=True)
class ViewBands:
    """Bands of a case, by which its views have colour."""

    case: Case
    bands: Bands
    tints: Tints

    @classmethod
    def of(cls, case: Case, states: Iterable[State]) -> ViewBands | None:
        """Bands of a case with `colour.bands` of 9 or 27, in some states; None for others.

        Raises InputError for an unfit spectrum, or one whose name no surface has.
        """
        if not case.colour.wavelengths:
            return None
        bands = Bands.of(case.colour.wavelengths)
        tints = Tints(case, bands)
        for state in states:
            tints.check(surfaces_of(case, state))
        return cls(case, bands, tints)

    def parts(
        self, scenes: Callable[[int, Tint], FacadeScenes], sampling: Sampling
    ) -> Iterator[ViewPart]:
        """Scenes of the bands, with fewer rays than those of a picture by luminance.

        `scenes` gives those of a colour channel with tinted surfaces.
        """
        paths, sky, panes = (
            max(1, n // FEWER) for n in (sampling.paths, sampling.sky, sampling.panes)
        )
        few = Sampling(max(1, sampling.samples // FEWER_SAMPLES), paths, sky, panes)
        accuracy = with_few_rays(self.case.accuracy, REPLICATES)
        stated = {"bands": list(self.bands.wavelengths), "spectra": self.tints.content}
        for band in range(len(self.bands)):
            tint = partial(self.tints.of, band)
            yield ViewPart(
                f"band_{band}", scenes(-1, tint), few.rounded(REPLICATES), accuracy, stated
            )

    def under(
        self, light: Daylight, outside: OutsideLuminances
    ) -> Iterator[tuple[OutsideLuminances, xr.Dataset]]:
        """Outside and sky of an instant in every band, as light by light of all."""
        spectra = SourceSpectra.of(self.case, light.alone(), self.bands)
        mireds = 1e6 / sky_temperatures(self.case, light, outside.table.reshape(1, -1))
        mireds = mireds.reshape(outside.table.shape)
        for k in range(len(self.bands)):
            ground = self.tints.ground(k)
            share = spectra.of_phase(k, mireds).astype(np.float32)
            here = outside.times(share, float(spectra.ground[k, 0]) * ground, spectra.sun[k, 0])
            yield here, spectra.of_band(light.sky, k, ground)


@dataclass(frozen=True, eq=False)
class ViewColours:
    """Light paths of a view in the bands of its case."""

    bands: ViewBands
    views: tuple[ViewByElement, ...]
    """Light paths in every band."""

    def rgb(
        self, L: np.ndarray, light: Daylight, outside: OutsideLuminances, indices: Indices,
        sources: Sources,
    ) -> np.ndarray:  # fmt: skip
        """Red, green and blue (primaries and white of BT.709) of a picture of luminances.

        Parameters
        ----------
        L : np.ndarray, shape (row, column)
            Luminances [cd/m²].
        light : Daylight
            Its one instant.
        outside : OutsideLuminances
            Sky, ground and sun of the instant.
        indices : tuple of int
            Fill of every opening.
        sources : Sources
            Those whose light the picture shows.

        Returns
        -------
        np.ndarray, shape (row, column, 3)
            [cd/m²]; below 0 where a colour is outside of the primaries.
        """
        weights = np.array([self.bands.bands.weights(name) for name in TRISTIMULUS])
        per_L = _divided(1.0, L)
        straight, gathered = np.zeros((2, 3, *L.shape))
        of_e, of_gathered, of_reflected = np.zeros((3, *L.shape))
        for seen, weight in zip(
            self._parts(light, outside, indices, sources), weights.T, strict=True
        ):
            E = _divided(seen.gathered, seen.reflected)
            e = _divided(_smooth(E * per_L), _smooth((seen.reflected > 0) * per_L))
            straight += weight[:, None, None] * seen.straight
            gathered += weight[:, None, None] * (seen.reflected * e)
            of_e += weight[1] * e
            of_gathered += weight[1] * seen.gathered
            of_reflected += weight[1] * seen.reflected
        xyz = straight + gathered * _divided(of_gathered, of_reflected * of_e)
        Y = np.maximum(xyz[1], 0)
        around = np.stack([_smooth(values, NEAR) for values in (*xyz, Y)])
        missed = np.maximum(L - Y, 0) * _divided(around[:3], around[3])
        xyz = xyz * _divided(np.minimum(L, Y), Y) + np.where(around[3] > 0, missed, L)
        xyz = np.where(xyz[1] > 0, xyz * _divided(L, xyz[1]), L)  # per that of white, so L is grey
        to_rgb = np.linalg.solve(to_xyz(BT709), np.diag(to_xyz(BT709).sum(axis=1)))
        return np.ascontiguousarray(np.moveaxis(np.tensordot(to_rgb, xyz, 1), 0, -1), np.float32)

    def _parts(
        self, light: Daylight, outside: OutsideLuminances, indices: Indices, sources: Sources,
    ) -> Iterator[LightParts]:  # fmt: skip
        """Parts of the light in every band."""
        under = self.bands.under(light, outside)
        for (here, of_band), traced in zip(under, self.views, strict=True):
            patches = sources.of_bins(of_band["sky"].values[0])
            yield in_parts(traced.in_state(indices), here.times(*sources), patches)


def _smooth(values: np.ndarray, edge: int = SQUARE) -> np.ndarray:
    """Mean over the square around each pixel."""
    return np.asarray(images.uniform_filter(values, edge))


def _divided(a: np.ndarray | float, b: np.ndarray) -> np.ndarray:
    """Quotient; 0 where the divisor is not above 0."""
    return np.where(b > 0, a / np.where(b > 0, b, 1), 0)
