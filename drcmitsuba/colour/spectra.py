"""Spectra of surfaces and panes: files of numbers, RGB and CIELAB; read, checked, at the bands."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from drcmitsuba.case.colour import Lab, Tint
from drcmitsuba.colour.bands import GRID, TRISTIMULUS, Bands
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import shortened

colour = lazy.module("colour")

MOST_BYTES = 1 << 20
"""Largest size of a file [bytes]."""
MOST = 10_000
"""Largest number of wavelengths."""
ROUNDED = 0.002
"""Largest sum of rounded shares above 1 that a pane may send on [–]."""
HELD = 1e6
"""Weight of equations that hold beside slopes that are small [1/nm]."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Spectrum:
    """Reflectance or transmittance by wavelength."""

    wavelengths: np.ndarray
    """Wavelengths [nm], rising, shape (wavelength,)."""
    values: np.ndarray
    """Shares of the light [–], shape (wavelength, column): transmittance, then reflectances of
    front and back, of a pane; reflectance of a surface."""

    def at(self, bands: Bands, column: int = 0) -> np.ndarray:
        """Values of a column at the bands' wavelengths [–], shape (band,)."""
        return bands.sampled(self.wavelengths, self.values[:, column])


def read_spectrum(path: Path, bands: Bands, most: float = 1.0) -> Spectrum:
    """Read a file of a spectrum: text with a wavelength and values in each line.

    Parameters
    ----------
    path : Path
        Numbers between commas, semicolons or blanks; nm, or µm where all wavelengths are below 100.
        Lines before the first number are a header, as in files of the IGDB, whose columns are
        transmittance and the reflectances of front and back.
    bands : Bands
        Bands that the spectrum has to cover.
    most : float
        Largest value that it may have; that of sources is infinite.

    Raises
    ------
    InputError
        It is no such text, or its wavelengths do not rise or do not cover the bands, or a value is
        below 0 or too large, or a pane sends on more than all light.
    """

    def refuse(field: str, got: str, remedy: str) -> InputError:
        return InputError(path, field, got, remedy)

    if path.stat().st_size > MOST_BYTES:
        raise refuse("size", f"{path.stat().st_size} bytes", "a spectrum has some hundred lines")
    rows: list[list[float]] = []
    for number, line in enumerate(path.read_text("utf-8", errors="replace").splitlines(), 1):
        words = [word for word in re.split(r"[\s,;]+", line.strip()) if word]
        if not words or (not NUMBER.fullmatch(words[0]) and not rows) or words[0][0] in "#{":
            continue
        if not all(NUMBER.fullmatch(word) for word in words) or len(words) < 2:
            remedy = "write a wavelength and its values in each line"
            raise refuse(f"line {number}", shortened(line.strip()), remedy)
        rows.append([float(word) for word in words])
        if len(rows[-1]) != len(rows[0]) or len(rows) > MOST:
            got = f"{len(rows[-1])} numbers after lines of {len(rows[0])}, {len(rows)} lines"
            raise refuse(f"line {number}", got, "give the same columns in each line")
    if len(rows) < 2:
        raise refuse("wavelengths", f"{len(rows)} of them", "give two or more lines of numbers")
    table = np.array(rows)
    wavelengths, values = table[:, 0], table[:, 1:]
    if wavelengths.max() < 100:
        wavelengths = 1000 * wavelengths  # µm
    if (np.diff(wavelengths) <= 0).any():
        at = wavelengths[1:][np.diff(wavelengths) <= 0][0]
        raise refuse("wavelengths", f"{at:g} nm after a larger one", "let them rise")
    low, high = bands.wavelengths[0], bands.wavelengths[-1]
    if wavelengths[0] > low or wavelengths[-1] < high:
        got = f"{wavelengths[0]:g} to {wavelengths[-1]:g} nm"
        raise refuse("wavelengths", got, f"cover {low:g} to {high:g} nm")
    is_visible = (wavelengths >= 380) & (wavelengths <= 780)
    visible = values[is_visible]
    if visible.min(initial=0) < 0:
        raise refuse("values", f"{visible.min():g}", "give shares of the light, 0 to 1")
    if visible.max(initial=0) > most:
        remedy = "are they in percent? Divide them by 100" if visible.max() <= 100 else "check them"
        raise refuse("values", f"up to {visible.max():g}, above 1", remedy)
    sent_on = (visible[:, :1] + visible[:, 1:3]).max(axis=1, initial=0)
    if sent_on.max(initial=0) > most + ROUNDED:
        at = wavelengths[is_visible][sent_on.argmax()]
        got = f"transmittance and reflectance add up to {sent_on.max():g} at {at:g} nm"
        raise refuse("values", got, "give transmittance, then reflectances of front and back")
    return Spectrum(wavelengths, values)


def of_rgb(rgb: Sequence[float]) -> Spectrum:
    """Smooth spectrum, from 0 to 1, of a linear RGB (sRGB primaries) under D65.

    It is the sigmoid of a parabola of Jakob and Hanika (2019): without the edges of other models,
    which nine wavelengths would miss.
    """
    values = _sigmoid(tuple(float(value) for value in rgb))
    return Spectrum(GRID, values[:, None])


@lru_cache(maxsize=1024)
def _sigmoid(rgb: tuple[float, ...]) -> np.ndarray:
    """Spectrum of a linear RGB on `GRID`; greys are even."""
    if max(rgb) - min(rgb) < 1e-6:
        return np.full(len(GRID), rgb[0])
    shape = colour.SpectralShape(GRID[0], GRID[-1], GRID[1] - GRID[0])
    xyz = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ @ np.array(rgb)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(observer.shape)
    made = colour.recovery.XYZ_to_sd_Jakob2019(xyz, observer, light)
    return np.asarray(made.copy().align(shape).values)


def smooth_mixes(bands: Bands) -> np.ndarray:
    """Weights of linear red, green and blue in each band, shape (band, 3), none below 0.

    They are the flattest spectra of the three (least squares of their slopes) that have their
    colours under D65 and add up to 1 in every band. So the sum of weighted channels from 0 to 1
    lies between them: it has the colour, and no band has more than all light, as by the primaries
    of Mallett and Yuksel (2019).
    """
    from scipy.optimize import nnls

    wavelengths, count = np.array(bands.wavelengths), len(bands)
    steps = np.diff(np.eye(count), axis=0) / np.sqrt(np.diff(wavelengths))[:, None]
    seen = np.array([bands.weights(name) for name in TRISTIMULUS])
    matrix = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    white = matrix.sum(axis=1, keepdims=True)  # weights are relative to D65
    slopes = np.kron(steps, np.eye(3))
    held = np.concatenate([np.kron(seen, np.eye(3)), np.kron(np.eye(count), np.ones(3))])
    wanted = np.concatenate([(matrix / white).ravel(), np.ones(count)])
    mixes, _ = nnls(
        np.concatenate([HELD * held, slopes]), np.append(HELD * wanted, np.zeros(len(slopes)))
    )
    return np.asarray(mixes).reshape(count, 3)


def of_lab(lab: Lab, source: str | Path, field: str) -> Spectrum:
    """Smooth spectrum of a colour in CIELAB under D65.

    A colour that no sRGB surface has raises InputError.
    """
    xyz = colour.Lab_to_XYZ(np.array(lab.lab), colour.CCS_ILLUMINANTS["cie_2_1931"]["D65"])
    rgb = np.asarray(colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB @ xyz)
    if rgb.min() < -0.005 or rgb.max() > 1.005:
        got = f"linear RGB {', '.join(f'{value:.2f}' for value in rgb)}: outside sRGB"
        raise InputError(source, field, got, "give the file of its spectrum")
    return of_rgb(np.clip(rgb, 0, 1))


def spectrum_of(tint: Tint, bands: Bands, source: str | Path, field: str) -> Spectrum:
    """Spectrum of a colour of the case, which errors name by its source and field."""
    if isinstance(tint, Path):
        return read_spectrum(tint, bands)
    return of_lab(tint, source, field) if isinstance(tint, Lab) else of_rgb(tint)
