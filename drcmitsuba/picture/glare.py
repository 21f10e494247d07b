"""Glare of a picture: DGP, UGR and DGI as functions of its glare sources.

With the vertical illuminance E_v at the eye, the luminance L_s, solid angle ω_s and position index
P_s of each glare source, and the luminance L_b of the background,

DGP = c₁ E_v + c₂ log₁₀(1 + Σ L_s² ω_s / (E_v^1.87 P_s²)) + c₃ [1]_,
UGR = 8 log₁₀(0.25 / L_b · Σ L_s² ω_s / P_s²) [2]_,
DGI = 10 log₁₀ Σ 0.478 L_s^1.6 Ω_s^0.8 / (L_b + 0.07 ω_s^½ L_s), Ω_s = ω_s / P_s².

References
----------
.. [1] J. Wienold, J. Christoffersen, "Evaluation methods and development of a new glare prediction
   model for daylight environments with the use of CCD cameras", Energy and Buildings 38(7), 2006.
.. [2] CIE 117, "Discomfort glare in interior lighting", 1995.
.. [3] J. Wienold, "Dynamic daylight glare evaluation", Building Simulation, Glasgow 2009.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drcmitsuba.picture import glare_sources
from drcmitsuba.picture.glare_sources import FARTHEST, GlareSources
from drcmitsuba.picture.picture import Picture
from drcmitsuba.picture.view import PictureView
from drcmitsuba.runtime.errors import InputError

MOST_PIXELS = 1 << 21
"""Largest number of pixels in which glare sources are found."""
LARGEST_FACTOR = 100.0
"""A threshold up to this number is a multiple of the mean luminance, as for `evalglare -b`."""


class DgpConstants(NamedTuple):
    """Constants of the equation of DGP."""

    illuminance: float
    """c₁ [1/lx]."""
    contrast: float
    """c₂ [–]."""
    offset: float
    """c₃ [–]."""


PAPER = DgpConstants(5.87e-5, 0.0918, 0.16)
"""Constants as they were published."""
EVALGLARE = DgpConstants(5.87e-5, 0.092, 0.159)
"""Constants of the program `evalglare`."""


@dataclass(frozen=True, eq=False)
class Glare:
    """Light at the eye, and glare sources, of a picture."""

    illuminance: float
    """Vertical illuminance E_v at the eye [lx]."""
    mean_luminance: float
    """Mean luminance of what is in front of the eye, by solid angle [cd/m²]."""
    threshold: float
    """Luminance above which a pixel is part of a glare source [cd/m²]."""
    sources: GlareSources
    notes: tuple[str, ...] = ()
    """Sentences on what makes the picture doubtful."""

    @property
    def background(self) -> float:
        """Luminance of the background L_b: illuminance not by the sources over π [cd/m²]."""
        return max(0.0, self.illuminance - float(self.sources.illuminance.sum())) / np.pi

    @property
    def contrast(self) -> float:
        """Contrast term of DGP, log₁₀(1 + Σ L_s² ω_s / (E_v^1.87 P_s²)) [–]."""
        return float(np.log10(1 + self._squares().sum() / max(self.illuminance, 1e-9) ** 1.87))

    def dgp(
        self,
        constants: DgpConstants = EVALGLARE,
        *,
        low_light: bool = False,
        age: float = 20.0,
    ) -> float:
        """Daylight glare probability.

        Parameters
        ----------
        constants : DgpConstants
            `EVALGLARE` or `PAPER`.
        low_light : bool
            Whether to multiply by e^x / (1 + e^x), x = 0.024 E_v − 4, for dim scenes (Wienold);
            `evalglare` 3.06 does not.
        age : float
            Age of the viewer [a]: divides by 1.1 − 0.5 age/100 (Wienold 2009): 1 at 20 years.

        Returns
        -------
        float
            Probability of disturbance from 0 to 1. The equation was fitted to offices from 0.2
            to 0.8 and E_v above 380 lx.
        """
        if not 0 < age <= 120:
            raise InputError("dgp", "age", f"{age}", "give years above 0 and up to 120")
        lit = constants.illuminance * self.illuminance
        value = lit + constants.contrast * self.contrast + constants.offset
        if low_light:
            value /= 1 + float(np.exp(4 - 0.024 * self.illuminance))
        return float(np.clip(value / (1.1 - 0.5 * age / 100), 0, 1))

    @property
    def ugr(self) -> float:
        """Unified glare rating [–]; NaN without sources or background."""
        return self._rating(8, 0.25 * self._squares().sum() / self._background())

    @property
    def dgi(self) -> float:
        """Daylight glare index [–]; NaN without sources or background."""
        s = self.sources
        apparent = s.solid_angle / s.position_index**2
        around = self._background() + 0.07 * np.sqrt(s.solid_angle) * s.luminance
        return self._rating(10, (0.478 * s.luminance**1.6 * apparent**0.8 / around).sum())

    def _squares(self) -> np.ndarray:
        s = self.sources
        return s.luminance**2 * s.solid_angle / s.position_index**2

    def _background(self) -> float:
        return self.background or np.nan

    @staticmethod
    def _rating(scale: float, total: float) -> float:
        return scale * float(np.log10(total)) if total > 0 else float("nan")


def glare(
    picture: Picture,
    *,
    view: PictureView | None = None,
    threshold: float = 2000.0,
    opening: float = 0.2,
    peak: float = 50_000.0,
) -> Glare:
    """Find the glare sources of a picture and what glare depends on.

    The defaults are those of `evalglare` 3.06.

    Parameters
    ----------
    picture : Picture
        Fisheye picture of 180°: what it leaves out of the view in front of the eye counts as dark.
    view : PictureView, optional
        View of the picture, where its file has none or a wrong one.
    threshold : float
        Luminance above which pixels are bright [cd/m²], or up to 100 a multiple of the mean
        luminance (`-b`).
    opening : float
        Opening angle within which bright pixels are one source [rad] (`-r`).
    peak : float
        Luminance above which pixels of a source are a source of their own [cd/m²] (`-Y`); infinite
        for none (`-x`).

    Returns
    -------
    Glare
        Illuminance, mean luminance and sources, with DGP, UGR and DGI.

    Raises
    ------
    InputError
        There is no view, the picture has more than 2 million pixels, or a parameter is unfit.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> view = picture.PictureView("equidistant", direction=(0, 1, 0), angles=(180, 180))
    >>> bright = np.full((60, 60, 3), 500, np.float32)
    >>> bright[12:24, 20:36] = 8000
    >>> office = picture.Picture(bright, view)
    >>> from drcmitsuba.picture.glare import glare
    >>> seen = glare(office)
    >>> len(seen.sources)
    1
    >>> bool(0 < seen.dgp() < 1)
    True
    """
    _refuse_unfit(picture, threshold, opening, peak)
    shown = picture.view_or(view)
    directions = shown.pixel_directions(*picture.shape)
    with np.errstate(invalid="ignore"):
        cosine = directions @ shown.frame[2]
        seen = cosine > 0
    omega = np.where(seen, shown.solid_angles(*picture.shape), 0)
    luminance = np.maximum(picture.luminance.astype(float), 0)
    flux = luminance * omega
    illuminance = float((flux * np.where(seen, cosine, 0)).sum())
    mean = float(flux.sum() / omega.sum())
    limit = threshold if threshold > LARGEST_FACTOR else threshold * mean
    sources = glare_sources.find(luminance, directions, omega, shown, limit, opening, peak)
    return Glare(illuminance, mean, limit, sources, _notes(luminance, shown))


def _notes(luminance: np.ndarray, view: PictureView) -> tuple[str, ...]:
    """Note a fisheye picture that a perspective view is stated for: its corners are black."""
    if view.kind != "perspective" or luminance[[0, 0, -1, -1], [0, -1, 0, -1]].any():
        return ()
    wide, high = view.angles
    return (
        f"the corners are black in a perspective view of {wide:g}° by {high:g}°: a fisheye picture "
        "needs its own view, such as -vta -vh 180 -vv 180",
    )


def _refuse_unfit(picture: Picture, threshold: float, opening: float, peak: float) -> None:
    rows, columns = picture.shape
    if rows * columns > MOST_PIXELS:
        remedy = f"reduce it to at most {MOST_PIXELS} pixels, such as 1024 by 1024"
        raise InputError("picture", "size", f"{columns} by {rows}", remedy)
    if not threshold > 0:
        raise InputError("glare", "threshold", f"{threshold}", "give a number above 0")
    if not 0 < opening <= FARTHEST:
        raise InputError("glare", "opening", f"{opening}", f"give 0 to {FARTHEST:g} rad")
    if not peak > 0:
        raise InputError("glare", "peak", f"{peak}", "give cd/m² above 0, or infinity")
