"""Random numbers: one seed for every purpose, replicate and place, and evenly spread sequences.

References
----------
.. [1] M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
"""

from __future__ import annotations

from enum import Enum, IntEnum
from functools import lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import TO_UNIT, random_bits

REPLICATES = 64
"""Largest number of replicates."""
_N = None


class Stream(Enum):
    """Purposes that random numbers serve; the value is the form of the key of a launch.

    A form holds fixed numbers, and None in the place of each index. Two forms differ in length, or
    in a fixed number at one place at least: no two streams share a key, whatever the indices.
    """

    CELL_AREAS = (5,)
    """Points that measure the areas of cells."""
    PATH_LENGTHS = (7,)
    """Paths that measure the mean number of vertices."""
    FRESH_SEED = (9,)
    """Seed of a second evaluation of the design that a search with the first seed has chosen."""
    PANE_GROUPS = (11,)
    """Directions on suns that tell through which panes they are seen."""
    EYE_PATHS = (13,)
    """Rays of the pixels of a picture, and their ways by mirrors and panes."""
    EYE_GATHER = (15,)
    """Rays from the surfaces that pixels show to other surfaces."""
    EYE_SKY = (17,)
    """Rays from the surfaces that pixels show to the sky."""
    EYE_PANES = (19,)
    """Rays from the surfaces that pixels show to scattering panes."""
    EYE_SUN = (21,)
    """Directions on the sun from the surfaces that pixels show."""
    EYE_PEAKS = (23,)
    """Directions along the peaks of films from the surfaces that pixels show."""
    BRIGHT_SURFACES = (25,)
    """Seed of further replicates of surfaces that eyes see bright."""
    COLOUR = (27,)
    """Seed of the simulation of bands of the spectrum."""
    SUN_RIMS = (0, 2)
    """Directions around the rim of each sun, of all replicates."""
    PATHS = (0, 4)
    """Gather paths of all replicates."""
    SUN_EDGES = (0, 3)
    """Directions on suns that a shadow's edge crosses, of all replicates."""
    PHOTONS = (_N, 6)
    """Photons; replicate."""
    CELL_RAYS = (_N, 10)
    """Rays from cells to other cells, of all replicates; round."""
    ROUNDS = (_N, 8)
    """Seed of a round of adaptive sampling; round."""
    ROOMS = (_N, 12)
    """Seed of further sensors that share light on cells; number of their group."""
    SEEN = (_N, 14)
    """Seed of what eyes see from a place; number of the place."""
    GLOW = (_N, 16)
    """Directions from films and rough mirrors that eyes see; part of the scene."""
    SUN_IMAGES = (_N, 18)
    """Directions on suns, and on their images, that eyes see; 0, or number of the chain from 1."""
    SUN_TILES = (_N, 20)
    """Rays of eyes near those that see mirrors without exact images; number of the launch."""
    OPENINGS = (_N, 22)
    """Seed of points on the scattering panes of an opening; number of the opening."""
    PANES = (_N, 0, _N)
    """Light on the faces of panes that scatter evenly; replicate, `Draw`."""
    FILMS = (_N, 0, 0, _N)
    """Light on films, and their answer to it; replicate, `Draw`."""
    FILMS_TO_PANES = (_N, 0, 1, _N)
    """Light of films on the faces of panes that scatter evenly; replicate, `Draw`."""
    COMPONENT_PANES = (_N, 0, 2, _N)
    """Light on the faces of panes of components; replicate, `Draw`."""
    CELLS = (0, 1, _N)
    """Light on cells, of all replicates; `Draw`."""
    SENSORS = (1, 1, _N)
    """Light on sensors, of all replicates; `Draw`."""

    def key(self, *indices: int) -> tuple[int, ...]:
        """Key of a launch: the form, with the indices in their places, as many as it has."""
        places = sum(number is None for number in self.value)
        if len(indices) != places:
            raise ValueError(f"{self.name}: {len(indices)} indices, the stream has {places}")
        each = iter(indices)
        return tuple(next(each) if number is None else number for number in self.value)


class Draw(IntEnum):
    """Directions or points drawn for light on receivers: the last index of a stream."""

    SKY = 0
    """Rays to the sky; on films, directions to the sky."""
    SUN = 1
    """Directions on suns."""
    PANES = 2
    """Points on panes that scatter evenly, and directions to them."""
    POINTS = 3
    """Points on the faces of panes."""
    PEAKS = 4
    """Directions along the peaks of films."""
    FILMS = 5
    """Points on films, and directions to them."""
    SUN_ANSWER = 6
    """Directions on suns, and in outgoing cells, for the answer of films."""
    MIRRORS = 7
    """Directions to planar mirrors, and on the images of suns in them."""


Key = tuple[Any, ...]
"""Stream and its indices but the last, which is a `Draw`."""


def launch_seed(base: int, stream: Stream, *indices: int) -> int:
    """Seed of one launch, below 2³²; launches of different streams or indices are independent.

    `base` is the seed of the case; `indices` fill the stream's form: replicate, material, … .
    """
    key = stream.key(*indices)
    return int(np.random.SeedSequence(base, spawn_key=key).generate_state(1)[0])


def case_seed(base: int, stream: Stream, *indices: int) -> int:
    """Seed of a further evaluation of a case, below 2³⁰ as a case's own; else as `launch_seed`."""
    return launch_seed(base, stream, *indices) >> 2


def number_in_replicate(place: mi.UInt32, replicate: int) -> mi.UInt32:
    """Number of a sensor or cell in a replicate: launches that join replicates take it as seed.

    `place` is the number of the sensor, or the key of the cell, below 2²⁶.
    """
    return place * mi.UInt32(REPLICATES) + dr.opaque(mi.UInt32, replicate)


def even_steps(dimensions: int) -> list[int]:
    """2³² / φʲ with φ^(d+1) = φ + 1: steps of a sequence that fills d dimensions evenly [1]."""
    phi = 2.0
    for _ in range(60):
        phi = (1 + phi) ** (1 / (dimensions + 1))
    return [int(2**32 / phi**j) for j in range(1, dimensions + 1)]


_STEPS = even_steps(4)


@lru_cache(maxsize=32)
def even_order(count: int, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Order of the first points of `even_numbers` along the dimension 0 or 1 of the first pair.

    Returns
    -------
    index, number : np.ndarray of uint32, shape (count,)
        Indices in rising order of their number without a shift, and these numbers in parts of 2³².
        A shift turns the order around.
    """
    number = (np.arange(count) * _STEPS[dimension] % (1 << 32)).astype(np.uint32)
    index = np.argsort(number, kind="stable").astype(np.uint32)
    return index, number[index]


def even_numbers(
    index: mi.UInt32, row: mi.UInt32, seed: int | mi.UInt32, pair: int,
    place: mi.UInt32 | int = 0,
) -> mi.Point2f:  # fmt: skip
    """Point of an even sequence in [0, 1)², one of two pairs of dimensions.

    Every row, place and seed has a random shift of its own (Cranley and Patterson), which makes
    estimates unbiased and rows independent. The sequence has the number `row`, that of a sensor,
    cell, sun …, and a second one, `place`; `index` counts its points, and the `pair` 0 or 1 of its
    four dimensions is taken.
    """
    return shifted_point(index, random_bits(row, seed + 0x9E3779B9 * pair, place), pair)


def shifted_point(
    index: mi.UInt32, shifts: tuple[mi.UInt32, mi.UInt32], pair: int = 0
) -> mi.Point2f:
    """Point of the sequence of `even_numbers` whose shifts are known, in parts of 2³²."""
    numbers = (
        index * mi.UInt32(step) + shift
        for step, shift in zip(_STEPS[2 * pair : 2 * pair + 2], shifts, strict=True)
    )
    return mi.Point2f(*(mi.Float(number >> 8) * TO_UNIT for number in numbers))
