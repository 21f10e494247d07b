"""Declination and hour angle of the sun, and its direction."""

from __future__ import annotations

import numpy as np


def direction_of_hour(
    latitude: float, declination: np.ndarray, hour_angle: np.ndarray
) -> np.ndarray:
    """Unit vector x east, y north, z up, shape (..., 3); the hour angle [deg] grows to the west."""
    phi, delta, h = (np.radians(angle) for angle in (latitude, declination, hour_angle))
    x = -np.cos(delta) * np.sin(h)
    y = np.cos(phi) * np.sin(delta) - np.sin(phi) * np.cos(delta) * np.cos(h)
    z = np.sin(phi) * np.sin(delta) + np.cos(phi) * np.cos(delta) * np.cos(h)
    return np.stack([x, y, z], axis=-1)


def declination_and_hour(latitude: float, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Declination and hour angle [deg] of directions (..., 3): the inverse of `direction`."""
    phi = np.radians(latitude)
    x, y, z = np.moveaxis(directions, -1, 0)
    declination = np.arcsin(np.clip(np.sin(phi) * z + np.cos(phi) * y, -1, 1))
    return np.degrees(declination), np.degrees(np.arctan2(-x, np.cos(phi) * z - np.sin(phi) * y))
