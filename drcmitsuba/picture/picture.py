"""A picture: radiance of its pixels in units of luminance, and what its file says of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.picture.view import PictureView
from drcmitsuba.runtime.errors import InputError

EFFICACY = 179.0
"""Luminous efficacy of white light in Radiance [lm/W]: cd/m² of a radiance of 1 W/(m² sr)."""
MOST_PIXELS = 1 << 25
"""Largest number of pixels of a picture: 8192 by 4096, 400 MB."""
LARGEST = 1e15
"""Largest value of a pixel [cd/m²], a million times that of the sun."""

Primaries = tuple[float, float, float, float, float, float, float, float]
RADIANCE: Primaries = (0.64, 0.33, 0.29, 0.6, 0.15, 0.06, 1 / 3, 1 / 3)
"""Chromaticities x, y of Radiance's red, green, blue and white."""
RADIANCE_WEIGHTS = (0.265, 0.670, 0.065)
"""Luminance weights of Radiance's channels, as its programs round them."""


@dataclass(frozen=True, eq=False)
class Picture:
    """Picture with its view.

    Raises
    ------
    InputError
        The array has another shape than (row, column, 3), or a value is not finite or too large.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> red = picture.Picture(np.full((4, 6, 3), (300, 0, 0), np.float32))
    >>> bool(red.luminance[0, 0] < 100)  # red is a fourth of a white's luminance
    True
    """

    rgb: np.ndarray
    """Red, green and blue, in units of luminance [cd/m²]: a white of luminance L has three times L.
    float32, shape (row, column, 3), rows from the top."""
    view: PictureView | None = None
    """None where the file has no view."""
    primaries: Primaries = RADIANCE
    """Chromaticities x, y of red, green, blue and white."""
    exposure: float = 1.0
    """Factor by which the file's values were multiplied, divided out of `rgb` [–]."""
    captured: str = ""
    """Local time as the file says it, YYYY:MM:DD hh:mm:ss; "" where it says none."""

    def __post_init__(self) -> None:
        if self.rgb.ndim != 3 or self.rgb.shape[2] != 3 or 0 in self.rgb.shape:
            raise InputError("picture", "rgb", f"shape {self.rgb.shape}", "give (row, column, 3)")
        for top in range(0, len(self.rgb), 64):
            fit = np.abs(self.rgb[top : top + 64]) <= LARGEST
            if not fit.all():
                row, column, _ = np.argwhere(~fit)[0]
                got = f"{self.rgb[top + row, column]} cd/m²"
                remedy = f"give finite values of at most {LARGEST:g} cd/m²"
                raise InputError(
                    "picture", f"pixel ({column}, {top + row}) from the top left", got, remedy
                )

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        rows, columns, _ = self.rgb.shape
        return rows, columns

    @property
    def weights(self) -> np.ndarray:
        """Share of each channel in the luminance of white, shape (3,); they sum to 1."""
        if self.primaries == RADIANCE:
            return np.array(RADIANCE_WEIGHTS)
        return to_xyz(self.primaries)[1]

    @property
    def luminance(self) -> np.ndarray:
        """Luminance [cd/m²], float32, shape (row, column)."""
        return self.rgb @ self.weights.astype(np.float32)

    def view_or(self, view: PictureView | None) -> PictureView:
        """The view given, or else the picture's own; InputError where there is none."""
        if view is None and self.view is None:
            raise InputError("picture", "view", "none in the file", "give the view of the picture")
        return view or self.view  # type: ignore[return-value]

    def directions(self) -> np.ndarray:
        """Unit vectors of the pixels' centres, (row, column, 3); NaN outside the projection."""
        return self.view_or(None).pixel_directions(*self.shape)

    def solid_angles(self) -> np.ndarray:
        """Solid angles of the pixels [sr], shape (row, column)."""
        return self.view_or(None).solid_angles(*self.shape)


def to_xyz(primaries: Primaries) -> np.ndarray:
    """Matrix from red, green and blue to X, Y and Z, where white has Y = 1, shape (3, 3).

    Raises
    ------
    InputError
        The primaries span no triangle around white.
    """
    xy = np.array(primaries, float).reshape(4, 2)
    with np.errstate(all="ignore"):
        columns = np.stack([xy[:, 0], xy[:, 1], 1 - xy.sum(axis=1)]) / xy[:, 1]
    if np.isfinite(columns).all() and np.linalg.cond(columns[:, :3]) < 1e6:
        scale = np.linalg.solve(columns[:, :3], columns[:, 3])
        if (scale > 0).all():
            return columns[:, :3] * scale
    got = " ".join(f"{v:g}" for v in primaries)
    raise InputError("picture", "primaries", got, "give red, green and blue around white")


def refuse_size(source: object, columns: int, rows: int, bytes_per_pixel: int = 12) -> None:
    """Raise InputError where a file states no pixels, or more than memory shall hold."""
    if min(columns, rows) < 1 or columns * rows * bytes_per_pixel > MOST_PIXELS * 12:
        got = f"{columns} by {rows} pixels of {bytes_per_pixel} B"
        remedy = f"give a picture of at most {MOST_PIXELS * 12 / 1e6:.0f} MB in memory"
        raise InputError(source, "size", got, remedy)
