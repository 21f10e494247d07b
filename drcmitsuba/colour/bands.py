r"""Bands: wavelengths that stand for the visible spectrum, with weights for responses of the eye.

The spectrum S of light that reaches an eye is a source's, times transmittances and reflectances.
With u = S / S_D65, interpolated between the wavelengths λ_k by natural cubic splines h_k, a
response r of the eye to it, relative to its response to D65, is

.. math:: \frac{\int u S_{D65} r}{\int S_{D65} r} \approx \sum_k w_k u(\lambda_k), \qquad
    w_k = \frac{\int h_k S_{D65} r}{\int S_{D65} r}.

D65 is exact. Products of two of 24 colours of the ColorChecker with daylight of 4100 to 24,000 K
have all responses within 3.7 % (root mean square 0.3 to 0.6) with 9 wavelengths, and within 0.4 %
with 27; sums over nine intervals of constant spectra, as other programs take them, have up to 26 %.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np

from drcmitsuba.runtime import lazy

colour = lazy.module("colour")

GRID = np.arange(380.0, 781.0, 5.0)
"""Wavelengths of tables [nm]."""
NINE = (413.0, 437.0, 466.0, 498.0, 529.0, 560.0, 592.0, 623.0, 665.0)
"""Wavelengths [nm] with the smallest errors of all responses to the products above."""
WAVELENGTHS = {9: NINE, 27: tuple(np.linspace(400.0, 700.0, 27).tolist())}
"""Wavelengths [nm] by their number."""
TRISTIMULUS = ("X", "Y", "Z")
ALPHA_OPIC = ("melanopic", "s_cone_opic", "m_cone_opic", "l_cone_opic", "rhodopic")
"""Responses of CIE S 026:2018."""
PHOTOPIC = 683.002
"""Luminous efficacy at 555 nm [lm/W], as CIE S 026 takes it."""


@lru_cache(maxsize=1)
def responses() -> dict[str, np.ndarray]:
    """Responses of the eye on `GRID`, by name.

    X, Y, Z are of the CIE 1931 observer, Y the photopic response; cones are the CIE 2006 10°
    fundamentals and rods the CIE 1951 observer, as in CIE S 026:2018; its melanopic response is the
    table of DOI 10.25039/CIE.DS.vqqhzp5a, every fifth nanometre.
    """
    shape = colour.SpectralShape(GRID[0], GRID[-1], GRID[1] - GRID[0])

    def aligned(table: object) -> np.ndarray:
        values = table.copy().align(shape).values  # type: ignore[attr-defined]
        return np.nan_to_num(np.atleast_2d(values.T))

    xyz = aligned(colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"])
    long, middle, short = aligned(colour.MSDS_CMFS["Stockman & Sharpe 10 Degree Cone Fundamentals"])
    [rods] = aligned(colour.SDS_LEFS["CIE 1951 Scotopic Standard Observer"])
    text = resources.files(__package__).joinpath("melanopic.csv").read_text("utf-8")
    table = np.array([line.split(",") for line in text.split()], float)
    melanopic = np.interp(GRID, *table.T)
    each = zip(ALPHA_OPIC, (melanopic, short, middle, long, rods), strict=True)
    return dict(zip(TRISTIMULUS, xyz, strict=True)) | dict(each)


@lru_cache(maxsize=1)
def d65() -> np.ndarray:
    """Relative spectrum of CIE standard illuminant D65 on `GRID`."""
    shape = colour.SpectralShape(GRID[0], GRID[-1], GRID[1] - GRID[0])
    values = colour.SDS_ILLUMINANTS["D65"].copy().align(shape).values
    return np.asarray(values, float)


def efficacy(response: str) -> float:
    """α-opic efficacy of luminous radiation of D65 [W/lm]: irradiance per illuminance."""
    every, light = responses(), d65()
    return float((every[response] @ light) / (PHOTOPIC * (every["Y"] @ light)))


@dataclass(frozen=True)
class Bands:
    """Wavelengths λ [nm] that stand for the visible spectrum."""

    wavelengths: tuple[float, ...]

    @classmethod
    def of(cls, count: int) -> Bands:
        """Bands by their number, 9 or 27."""
        return cls(WAVELENGTHS[count])

    def __len__(self) -> int:
        """Count the bands."""
        return len(self.wavelengths)

    @property
    def splines(self) -> np.ndarray:
        """Splines h on `GRID`, shape (band, wavelength); constant beyond the outer wavelengths."""
        from scipy.interpolate import CubicSpline

        nodes = np.array(self.wavelengths)
        spline = CubicSpline(nodes, np.eye(len(nodes)), bc_type="natural")
        return np.asarray(spline(np.clip(GRID, nodes[0], nodes[-1])).T)

    def weights(self, response: str) -> np.ndarray:
        """Weights w of the bands in a response, shape (band,); they add up to 1."""
        power = d65() * responses()[response]
        return np.asarray(self.splines @ power / power.sum())

    def sampled(self, wavelengths: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values of a spectrum (wavelength [nm], …) at the bands' wavelengths, (band, …)."""
        columns = values.reshape(len(wavelengths), -1).T
        at = [np.interp(self.wavelengths, wavelengths, column) for column in columns]
        return np.stack(at, axis=1).reshape(len(self), *values.shape[1:])

    def relative(self, wavelengths: np.ndarray, power: np.ndarray) -> np.ndarray:
        """Power of sources (wavelength, …) beside that of D65 of equal illuminance, (band, …).

        Light of 1 lx is this many lx in every band; weighed by the photopic response it is 1 lx.
        """
        u = self.sampled(wavelengths, power)
        u = u / self.sampled(GRID, d65()).reshape(-1, *[1] * (u.ndim - 1))
        return np.asarray(u / np.tensordot(self.weights("Y"), u, 1))
