"""Colours of Radiance's materials as the engine has them."""

from __future__ import annotations

import numpy as np

from drcmitsuba.model.materials import Reflectance
from drcmitsuba.schema import LUMINANCE_WEIGHTS

GREY = 1e-6
"""Largest difference between the channels of a grey [–]."""


def luminance(channels: np.ndarray) -> np.ndarray:
    """Luminance of red, green and blue on the last axis; Radiance's own weights differ."""
    return np.asarray(channels @ np.array(list(LUMINANCE_WEIGHTS.values())))


def is_grey(channels: np.ndarray) -> bool:
    """Whether red, green and blue are the same."""
    return bool(np.ptp(channels) <= GREY)


def reflectance(channels: np.ndarray) -> Reflectance:
    """One number for a grey, else three."""
    if is_grey(channels):
        return float(channels[1])
    red, green, blue = channels.tolist()
    return red, green, blue
