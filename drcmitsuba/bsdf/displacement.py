"""Interpolation between two distributions of light whose lobes move.

A distribution is an array (m, m) of light over direction cosines x, y from −1 to 1. A lobe is
light that two neighbouring distributions share after a shift, and it moves by this shift;
cross-fading would show every lobe twice. The peak of the correlation gives the shift. The search is
repeated while shared light remains, so mirrored and redirected lobes move independently. The rest
is cross-faded.

Light is conserved: at t the sum is (1 − t) · Σa + t · Σb, less the light that a fractional shift
carries over the edge of the array (at most one pixel).

References
----------
.. [1] N. Bonneel, M. van de Panne, S. Paris, W. Heidrich, "Displacement interpolation using
   Lagrangian mass transport", 2011: the exact transport that this greedy search approximates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUNDS = 4
"""Largest number of lobes, each with its own shift."""
LIKE = 1.5
"""Largest ratio of a lobe's light in one distribution to that in the other."""
LITTLE = 0.01
"""Fraction of the darker distribution's light: if less is shared, the search ends."""


@dataclass(frozen=True)
class Passage:
    """Moving lobes and resting light of two distributions a and b."""

    lobes: tuple[tuple[np.ndarray, np.ndarray, tuple[int, int]], ...]
    """Light of a lobe in a and in b, shape (m, m) each, and its shift from a to b [pixel]."""
    rest: tuple[np.ndarray, np.ndarray]
    """Remaining light of a and of b, shape (m, m) each, which is cross-faded in place."""

    def at(self, t: float) -> np.ndarray:
        """Distribution (m, m) between a (t = 0) and b (t = 1)."""
        total = (1 - t) * self.rest[0] + t * self.rest[1]
        for a, b, (dx, dy) in self.lobes:
            total = total + (1 - t) * moved(a, t * dx, t * dy)
            total = total + t * moved(b, (t - 1) * dx, (t - 1) * dy)
        return total


def passage(a: np.ndarray, b: np.ndarray, cover: np.ndarray, reach: float) -> Passage:
    """Separate the lobes that move between two distributions from the light that rests.

    `a`, `b` and `cover`, the fraction of each pixel that lies in the disk, have the shape (m, m);
    `reach` is the longest shift [pixel].
    """
    inside = cover > 0.99
    # The Lambertian part of a distribution, its least value inside the disk, rests.
    left_a, left_b = (np.maximum(g - float(g[inside].min()) * cover, 0) for g in (a, b))
    enough = LITTLE * min(left_a.sum(), left_b.sum())
    lobes = []
    for _ in range(ROUNDS):
        shift = _likely_shift(left_a, left_b, reach)
        part_a = np.minimum(left_a, LIKE * moved(left_b, -shift[0], -shift[1]))
        part_b = np.minimum(left_b, LIKE * moved(left_a, *shift))
        if min(part_a.sum(), part_b.sum()) <= enough:
            break
        lobes.append((part_a, part_b, shift))
        left_a, left_b = left_a - part_a, left_b - part_b
    return Passage(tuple(lobes), (a - sum(p for p, *_ in lobes), b - sum(p for _, p, _ in lobes)))


def _likely_shift(a: np.ndarray, b: np.ndarray, reach: float) -> tuple[int, int]:
    """Shift [pixel], at most `reach` long, at which a correlates best with b."""
    m = len(a)
    size = (2 * m, 2 * m)
    correlation = np.fft.irfft2(np.conj(np.fft.rfft2(a, size)) * np.fft.rfft2(b, size), size)
    step = np.fft.fftfreq(2 * m, 1 / (2 * m))
    correlation = np.where(np.hypot(step[:, None], step) <= reach, correlation, -np.inf)
    i, j = np.unravel_index(int(correlation.argmax()), size)
    return int(step[i]), int(step[j])


def moved(g: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """Shift an array (m, m) by dx and dy pixels, fractions included; pixels that enter are 0."""
    out = np.zeros_like(g)
    fx, fy = int(np.floor(dx)), int(np.floor(dy))
    for i, wx in ((fx, 1 - (dx - fx)), (fx + 1, dx - fx)):
        for j, wy in ((fy, 1 - (dy - fy)), (fy + 1, dy - fy)):
            if wx * wy > 0:
                to, source = _overlap(i, j, len(g))
                out[to] += wx * wy * g[source]
    return out


def _overlap(i: int, j: int, m: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of the part that a shift by i, j pixels keeps in an array: after and before it."""
    to = (slice(max(i, 0), max(m + min(i, 0), 0)), slice(max(j, 0), max(m + min(j, 0), 0)))
    source = (slice(max(-i, 0), max(m + min(-i, 0), 0)), slice(max(-j, 0), max(m + min(-j, 0), 0)))
    return to, source
