"""The view of a picture: directions of its pixels and the solid angles that they cover."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from drcmitsuba.model.model import View
from drcmitsuba.model.radiance.text import FileLine
from drcmitsuba.model.radiance.views import view_options
from drcmitsuba.picture.projection import PROJECTIONS, Projection
from drcmitsuba.runtime.errors import InputError

KINDS = {
    "perspective": "v", "hemispherical": "h", "equidistant": "a", "equisolid": "e",
    "stereographic": "s", "parallel": "l", "cylindrical": "c",
}  # fmt: skip
"""Letters of `-vt` by the kind of view. Radiance has no equisolid view and refuses `-vte`; parallel
and cylindrical pictures can be shown, but directions of their pixels are not computed."""
_WORDS = {letter: kind for kind, letter in KINDS.items()}
_CORNERS = 1 << 18
"""Number of pixels whose corners are in memory at a time."""

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class PictureView:
    """View of a picture: projection, place, direction and angles.

    Raises
    ------
    InputError
        The kind is unknown, a vector has no length, up is along the direction, or an angle is too
        large for the kind.

    Examples
    --------
    >>> from drcmitsuba import picture
    >>> eye = picture.PictureView("equidistant", (0, 1, 0), position=(2.0, 1.0, 1.2))
    >>> eye.options()
    '-vta -vp 2 1 1.2 -vd 0 1 0 -vu 0 0 1 -vh 180 -vv 180 -vs 0 -vl 0'
    """

    kind: str
    """`perspective`, `hemispherical`, `equidistant`, `equisolid`, `stereographic`, `parallel` or
    `cylindrical`."""
    direction: Vector = (0.0, 1.0, 0.0)
    """To the centre of the view, of any length."""
    up: Vector = (0.0, 0.0, 1.0)
    """Vector that points up in the picture, of any length."""
    angles: tuple[float, float] = (180.0, 180.0)
    """Angles across and up the picture [deg]; lengths [m] of a parallel view."""
    position: Vector = (0.0, 0.0, 0.0)
    """Place of the eye [m]."""
    shift: float = 0.0
    """Shift of the picture to the right over its width [–], as a part of a larger picture has."""
    lift: float = 0.0
    """Shift of the picture up over its height [–]."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise self._error("kind", repr(self.kind), f"give one of {', '.join(KINDS)}")
        for field in fields(self)[1:]:
            if not np.isfinite(getattr(self, field.name)).all():
                raise self._error(field.name, str(getattr(self, field.name)), "give finite numbers")
        lengths = np.linalg.norm([self.direction, self.up], axis=1)
        across = np.linalg.norm(np.cross(self.direction, self.up))
        if not across > 1e-9 * lengths.prod():
            got = f"direction {self.direction} and up {self.up}"
            raise self._error("up", got, "give an up vector across the direction")
        widest = self._widest()
        if not 0 < min(self.angles) <= max(self.angles) <= widest:
            got = f"{self.angles[0]:g} by {self.angles[1]:g}"
            raise self._error("angles", got, f"give angles above 0 and up to {widest:g}")

    def _widest(self) -> float:
        """Largest angle across [deg]."""
        if self.kind in PROJECTIONS:
            return float(np.degrees(2 * PROJECTIONS[self.kind].widest))
        return 360.0 if self.kind == "cylindrical" else 1e9

    def _error(self, field: str, got: str, remedy: str) -> InputError:
        return InputError("view", field, got, remedy)

    @property
    def frame(self) -> np.ndarray:
        """Unit vectors to the right, up and forward, shape (3, 3)."""
        forward = np.array(self.direction) / np.linalg.norm(self.direction)
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(right, forward), forward])

    @property
    def projection(self) -> Projection:
        """Projection of the kind; InputError for parallel and cylindrical views."""
        if self.kind not in PROJECTIONS:
            raise self._error("kind", self.kind, f"give a picture of {', '.join(PROJECTIONS)} view")
        return PROJECTIONS[self.kind]

    @property
    def half_size(self) -> np.ndarray:
        """Distance ρ of the picture's edges from its centre, across and up, shape (2,)."""
        return self.projection.distance(np.radians(self.angles) / 2)

    def directions(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Directions that places in the picture show.

        Parameters
        ----------
        x, y : np.ndarray
            Places over width and height [–], from the lower left corner; they broadcast.

        Returns
        -------
        np.ndarray, shape (..., 3)
            Unit vectors; NaN where the projection has no direction.
        """
        local, inside = self._local(x, y)
        return np.where(inside[..., None], local @ self.frame, np.nan)

    def _local(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors to the right, up and forward, and whether the projection reaches the place.

        Places beyond the projection have the direction at its edge.
        """
        wide, high = self.half_size
        u = 2 * wide * (np.asarray(x, float) - 0.5 + self.shift)
        v = 2 * high * (np.asarray(y, float) - 0.5 + self.lift)
        rho = np.hypot(u, v)
        farthest = self.projection.distance(np.float64(self.projection.widest))
        theta = self.projection.angle(np.minimum(rho, farthest))
        aside = np.sin(theta) / np.maximum(rho, 1e-300)
        local = np.stack([u * aside, v * aside, np.broadcast_to(np.cos(theta), rho.shape)], axis=-1)
        return local, rho <= farthest

    def places(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places in the picture that show directions.

        Parameters
        ----------
        directions : np.ndarray, shape (..., 3)
            Vectors of any length.

        Returns
        -------
        x, y : np.ndarray
            Places over width and height [–], from the lower left corner: inside the picture both
            are from 0 to 1. NaN beyond the projection's largest angle.
        """
        local = np.asarray(directions, float) @ self.frame.T
        aside = np.hypot(local[..., 0], local[..., 1])
        theta = np.arctan2(aside, local[..., 2])
        rho = self.projection.distance(np.minimum(theta, self.projection.widest))
        scale = np.where(theta <= self.projection.widest, rho, np.nan) / np.maximum(aside, 1e-300)
        wide, high = 2 * self.half_size
        x = local[..., 0] * scale / wide + 0.5 - self.shift
        return x, local[..., 1] * scale / high + 0.5 - self.lift

    def pixel_directions(self, rows: int, columns: int) -> np.ndarray:
        """Unit vectors of the centres of pixels, (row, column, 3), rows from the top.

        NaN where the projection has no direction, as in the corners of a `hemispherical` picture.
        """
        y = 1 - (np.arange(rows)[:, None] + 0.5) / rows
        return self.directions((np.arange(columns) + 0.5) / columns, y)

    def solid_angles(self, rows: int, columns: int) -> np.ndarray:
        """Solid angles of the pixels [sr], shape (row, column), rows from the top.

        A pixel is taken as the spherical quadrilateral of its four corners; corners beyond the
        projection lie on its edge. The sum is the solid angle of the whole picture.
        """
        x = np.arange(columns + 1) / columns
        omega = np.empty((rows, columns))
        step = max(1, _CORNERS // columns)
        for top in range(0, rows, step):
            edges = np.arange(top, min(top + step, rows) + 1)
            corners, _ = self._local(x, 1 - edges[:, None] / rows)
            omega[top : top + step] = _quadrilaterals(corners)
        return omega

    def options(self) -> str:
        """The view as options of Radiance's programs, such as `-vth -vp 0 0 1.2 …`."""
        vectors = zip(("-vp", "-vd", "-vu"), (self.position, self.direction, self.up), strict=True)
        words = [f"-vt{KINDS[self.kind]}"]
        words += [f"{key} {' '.join(f'{v:.9g}' for v in vector)}" for key, vector in vectors]
        words += [f"-vh {self.angles[0]:.9g} -vv {self.angles[1]:.9g}"]
        words += [f"-vs {self.shift:.9g} -vl {self.lift:.9g}"]
        return " ".join(words)


def from_options(options: str, file: Path, line: int = 1) -> PictureView:
    """View that options of Radiance's programs state.

    Parameters
    ----------
    options : str
        Options such as `-vta -vp 0 0 1.2 -vd 0 1 0 -vh 180 -vv 180`; what is left out has
        Radiance's default.
    file : Path
        File that they stand in, for messages.
    line : int
        Line of the file.

    Raises
    ------
    InputError
        An option is unknown, or a value is unfit.
    """
    place = FileLine(file, line)
    # The equisolid view is no view of Radiance, so its reader of options does not know it.
    equisolid = re.search(r"(?:^|\s)-vte(?=\s|$)", options) is not None
    given = view_options(re.sub(r"(^|\s)-vte(?=\s|$)", r"\1-vta", options), place)
    try:
        return PictureView(
            kind="equisolid" if equisolid else _WORDS[given["-vt"]],
            direction=given["-vd"], up=given["-vu"], position=given["-vp"],
            angles=(*given["-vh"], *given["-vv"]), shift=given["-vs"][0], lift=given["-vl"][0],
        )  # fmt: skip
    except InputError as error:
        raise place.error(f"view: {error.field}", error.got, error.remedy) from None


def of_model(view: View) -> PictureView:
    """View of a picture that shows a view of a model."""
    return PictureView(_WORDS[view.kind], view.direction, view.up, view.angles, view.position)


def _quadrilaterals(corners: np.ndarray) -> np.ndarray:
    """Solid angles [sr] (row, column) between unit vectors (row + 1, column + 1, 3)."""
    a, b = corners[:-1, :-1], corners[:-1, 1:]
    d, c = corners[1:, :-1], corners[1:, 1:]
    return _triangles(a, b, c) + _triangles(a, c, d)


def _triangles(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Solid angles [sr] of spherical triangles, after van Oosterom and Strackee (1983)."""
    volume = np.abs(np.einsum("...i,...i", a, np.cross(b - a, c - a)))  # exact for small triangles
    dots = (np.einsum("...i,...i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    return 2 * np.arctan2(volume, 1 + sum(dots))
