"""A straight mirrored square duct, exact: unfolded about its walls, every light path is straight.

The duct has the width 1 and the length A (its aspect) along z, its four walls mirror the share ρ of
the light at every incidence, and its ends are open. A ray of the direction (a, b, 1) moves t = A·a
widths to the side on its way; in the unfolded duct it crosses every wall that lies between, and so
does one that enters at u widths from a wall: ⌊u + t⌋ of them. Over the entry, u is even, thus the
share 1 − f of the rays meets n = ⌊t⌋ mirrors and the share f = t − n meets one more:

    X(t) = (1 − f) ρⁿ + f ρⁿ⁺¹

and the duct transmits T = X(A·|a|) · X(A·|b|) of a collimated beam that fills its entry. The same
in hinges: X(t) = Σ_k p_k (1 − t/k)₊ with p_k = k ρ^(k−1) (1 − ρ)², Σ p_k = 1. What is (1 − t/k)₊ of
a duct with black walls and the width k; so a diffuse source has the view factors of its ends,

    T = Σ_k Σ_m p_k p_m F(k/A, m/A).

For a duct of another width w and length l the aspect is l / w. Nothing of the package is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Stripe:
    """Where a part of a collimated beam leaves the duct, along one axis.

    Parameters
    ----------
    low, high : float
        Between these places on the exit, 0 and 1 being the walls.
    weight : float
        ρ to the number of mirrors met.
    sign : int
        Of this component of its direction: even numbers of mirrors keep what it was.
    """

    low: float
    high: float
    weight: float
    sign: int


def stripes(t: float, reflectance: float) -> tuple[Stripe, Stripe]:
    """Both parts of a beam that moves t widths (of either sign) along an axis."""
    n = int(np.floor(abs(t)))
    f = abs(t) - n

    def stripe(unfolded: tuple[float, float], mirrors: int) -> Stripe:
        """Fold an interval of the unfolded duct back, `mirrors` walls away."""
        low, high = (x - mirrors for x in unfolded)
        turned = (mirrors % 2 == 1) != (t < 0)
        if turned:
            low, high = 1 - high, 1 - low
        return Stripe(low, high, reflectance**mirrors, -1 if turned else 1)

    return stripe((n + f, n + 1), n), stripe((n + 1, n + 1 + f), n + 1)


def along(t: np.ndarray, reflectance: float) -> np.ndarray:
    """X(t): transmittance along one axis of a beam that moves t widths."""
    n = np.floor(abs(t))
    f = abs(t) - n
    return reflectance**n * (1 - f * (1 - reflectance))


def collimated(direction: np.ndarray, aspect: float, reflectance: float) -> np.ndarray:
    """Transmitted share of beams that fill the entry.

    Parameters
    ----------
    direction : np.ndarray, shape (..., 3)
        In which the light goes, z > 0.
    aspect, reflectance : float

    Returns
    -------
    np.ndarray, shape (...)
    """
    d = np.asarray(direction, float)
    t = aspect * d[..., :2] / d[..., 2:]
    return along(t, reflectance).prod(axis=-1)


def exit_cells(
    direction: np.ndarray, aspect: float, reflectance: float, count: int
) -> dict[tuple[int, int], np.ndarray]:
    """Irradiance on the exit, over that on the entry, in count × count cells.

    Returns
    -------
    dict
        By the signs of the outgoing direction's x and y, arrays (x, y) of shape (count, count).
        Each entry is the mean over its cell, without any error; the mean of all is `collimated`.
    """
    edges = np.linspace(0, 1, count + 1)

    def covered(stripe: Stripe) -> np.ndarray:
        inside = np.minimum(edges[1:], stripe.high) - np.maximum(edges[:-1], stripe.low)
        return stripe.weight * np.maximum(inside, 0) * count

    x, y, z = (float(v) for v in direction)
    cells: dict[tuple[int, int], np.ndarray] = {}
    for sx in stripes(aspect * x / z, reflectance):
        for sy in stripes(aspect * y / z, reflectance):
            key, part = (sx.sign, sy.sign), np.outer(covered(sx), covered(sy))
            cells[key] = cells.get(key, 0) + part
    return cells


def on_disk(centre: np.ndarray, diameter: float, count: int) -> np.ndarray:
    """Directions evenly over the solid angle of a disk of so many degrees, shape (count, 3)."""
    centre = np.asarray(centre, float) / np.linalg.norm(centre)
    helper = np.eye(3)[np.argmin(abs(centre))]
    east = np.cross(helper, centre)
    east /= np.linalg.norm(east)
    i = np.arange(count)
    # Even in solid angle: 1 − cos is even between 0 and its largest value.
    height = 2 * np.sin(np.radians(diameter / 4)) ** 2 * (i + 0.5) / count
    sine, angle = np.sqrt(height * (2 - height)), np.pi * (3 - 5**0.5) * i
    flat = np.cos(angle)[:, None] * east + np.sin(angle)[:, None] * np.cross(centre, east)
    return (1 - height)[:, None] * centre + sine[:, None] * flat


def disk(
    direction: np.ndarray, diameter: float, aspect: float, reflectance: float, count: int = 20_000
) -> float:
    """Transmitted share of the light of a disk (a sun), all of it before the entry.

    Parameters
    ----------
    direction : np.ndarray, shape (3,)
        In which the light of its centre goes.
    diameter : float
        [°].
    aspect, reflectance : float
    count : int
        Directions, even over the disk; the error goes down faster than 1/count.
    """
    d = on_disk(direction, diameter, count)
    return float(np.average(collimated(d, aspect, reflectance), weights=d[:, 2]))


def between_rectangles(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """View factor of two equal rectangles face to face, with sides x and y times their distance.

    Howell, *A Catalog of Radiation Heat Transfer Configuration Factors*, C-11.
    """
    p, q = np.sqrt(1 + x**2), np.sqrt(1 + y**2)
    log = np.log(p * q / np.sqrt(1 + x**2 + y**2))
    across = x * q * np.arctan(x / q) + y * p * np.arctan(y / p)
    return 2 / (np.pi * x * y) * (log + across - x * np.arctan(x) - y * np.arctan(y))


def diffuse(aspect: float, reflectance: float, rest: float = 1e-10) -> float:
    """Transmitted share of a Lambertian source that covers the entry, or of an even sky before it.

    Parameters
    ----------
    aspect, reflectance : float
    rest : float
        The sums end where less than this is left of Σ p_k = 1; twice that is the largest error.
        Their terms are some (20 / (1 − ρ))²: half a second at ρ = 0.99.
    """
    if reflectance == 1 or aspect == 0:
        return 1.0
    r, last = reflectance, 1
    while (1 + last * (1 - r)) * r**last > rest:  # Σ p_k beyond the last
        last += 1
    k = np.arange(1, last + 1)
    p = k * r ** (k - 1.0) * (1 - r) ** 2
    total = 0.0
    for i in range(last):
        row = p[i] * p[i:] * between_rectangles(k[i] / aspect, k[i:] / aspect)
        total += 2 * row.sum() - row[0]  # F(x, y) = F(y, x)
    return float(total)
