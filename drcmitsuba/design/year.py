"""What a design needs of a year: its tiles, and the illuminance by a composition of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np


class Tiles(Protocol):
    """Parts of a façade, rectangles in its plane.

    Parameters
    ----------
    area : np.ndarray, shape (tile,)
        [m²].
    bounds : np.ndarray, shape (tile, 4)
        Left, right, bottom, top on the façade, seen from outside [m].
    """

    @property
    def area(self) -> np.ndarray: ...  # noqa: D102
    @property
    def bounds(self) -> np.ndarray: ...  # noqa: D102


class Illuminances(Protocol):
    """Illuminance of a year, tensors of shape (time, sensor) [lx].

    Parameters
    ----------
    open, shaded : mi.TensorXf
        With the shade open, and before all clear tiles.
    direct : mi.TensorXf
        By direct sun, shade open.
    """

    @property
    def open(self) -> Any: ...  # noqa: D102
    @property
    def shaded(self) -> Any: ...  # noqa: D102
    @property
    def direct(self) -> Any: ...  # noqa: D102


class Year(Protocol):
    """A façade's coefficients under the sky of a year.

    Parameters
    ----------
    tiles : Tiles
    materials : tuple of str
        Columns of a composition; "wall" is one of them.
    months : np.ndarray, shape (time,)
        1 to 12.
    step_hours : float
        What one time stamp stands for [h].
    """

    @property
    def tiles(self) -> Tiles: ...  # noqa: D102
    @property
    def materials(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def months(self) -> np.ndarray: ...  # noqa: D102
    @property
    def step_hours(self) -> float: ...  # noqa: D102

    def illuminance(self, share: Any, scale: Mapping[str, Any] = ...) -> Illuminances:
        """Give E of a composition.

        Parameters
        ----------
        share : mi.TensorXf (tile, material)
            Parts of each tile's area; rows add up to 1. Gradients flow through.
        scale : mapping of str to mi.Float
            Light through these materials is multiplied.
        """
        ...
