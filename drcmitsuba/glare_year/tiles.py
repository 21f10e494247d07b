"""Tiles of an eye's rays, and which of their rays are near enough to make one source."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drcmitsuba.runtime import lazy

spatial = lazy.module("scipy.spatial")

MOST_RAYS = 16
"""Largest number of rays of a tile."""
GROUPS = MOST_RAYS // 4
"""Number of groups of four rays of a tile."""
PAIRS = 1 << 13
"""Number of pairs of tiles whose rays are compared at once."""


@dataclass(frozen=True, eq=False)
class Links:
    """Pairs of tiles whose rays may be within half of the opening angle."""

    one: np.ndarray
    """First tile of every link, in rising order, int, shape (link,)."""
    two: np.ndarray
    """Tile before it that a link leads to, int, shape (link,)."""
    reach: np.ndarray
    """Rays of the second tile, as bits, that are near any of some rays of the first: of each group
    of four rays every subset, shape (link, GROUPS, 16)."""

    def first(self, tiles: int) -> np.ndarray:
        """First link of every tile, and last the number of links, int, shape (tile + 1,)."""
        return np.searchsorted(self.one, np.arange(tiles + 1))

    def take(self, which: np.ndarray) -> Links:
        """Some of the links."""
        return Links(self.one[which], self.two[which], self.reach[which])


@dataclass(frozen=True, eq=False)
class EyeTiles:
    """Rays of an eye by tile."""

    first: np.ndarray
    """First ray of every tile, and last the number of rays, int, shape (tile + 1,)."""
    rays: np.ndarray
    """Unit vectors, sorted by tile, at most `MOST_RAYS` of each, shape (ray, 3)."""
    pixel: np.ndarray
    """Pixel whose luminance each ray has, int, shape (ray,)."""
    solid_angle: float
    """Solid angle of a ray [sr]."""
    forward: np.ndarray
    """Lines of sight of the views, shape (view, 3)."""
    opening: float = 0.2
    """Opening angle within which bright rays are one source [rad]."""

    def __len__(self) -> int:
        """Count the tiles."""
        return len(self.first) - 1

    def take(self, kept: np.ndarray) -> tuple[EyeTiles, np.ndarray]:
        """Some of the tiles, bool (tile,), and the pixels of their rays, which are numbered anew.

        Returns
        -------
        EyeTiles
        np.ndarray of int, shape (pixel,)
            Former numbers of the pixels.
        """
        sizes = np.diff(self.first)
        here = np.repeat(kept, sizes)
        first = np.r_[0, np.cumsum(sizes[kept])]
        pixels, pixel = np.unique(self.pixel[here], return_inverse=True)
        return replace(self, first=first, rays=self.rays[here], pixel=pixel.ravel()), pixels

    def opened(self, opening: float) -> EyeTiles:
        """Tiles whose rays are joined within another opening angle [rad]."""
        return self if self.opening == opening else replace(self, opening=opening)

    @cached_property
    def direction(self) -> np.ndarray:
        """Unit vectors to the tiles' centres, shape (tile, 3)."""
        middle = np.add.reduceat(self.rays, self.first[:-1], axis=0)
        return np.asarray(middle / np.linalg.norm(middle, axis=1, keepdims=True))

    @cached_property
    def by_pixel(self) -> np.ndarray:
        """Solid angles of the pixels [sr], shape (pixel,)."""
        return self.solid_angle * np.bincount(self.pixel)

    @cached_property
    def ahead(self) -> np.ndarray:
        """Whether each view has each tile in front of it, shape (view, tile)."""
        return np.asarray(self.forward @ self.direction.T > 0)

    @cached_property
    def members(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pixels of the tiles: the first of each tile and last their number, indices, and rays.

        A pixel's rays of the tile are bits: bit i stands for the tile's ray i.
        """
        of_tile = np.repeat(np.arange(len(self)), np.diff(self.first))
        bit = 1 << (np.arange(len(self.rays)) - self.first[of_tile])
        pair, at = np.unique(np.stack([of_tile, self.pixel], 1), axis=0, return_inverse=True)
        rays = np.bincount(at.ravel(), bit).astype(np.uint32)
        return np.searchsorted(pair[:, 0], np.arange(len(self) + 1)), pair[:, 1], rays

    @cached_property
    def links(self) -> tuple[Links, Links]:
        """Links between tiles that the same views have in front of them, and all others."""
        of_tile = np.repeat(np.arange(len(self)), np.diff(self.first))
        spread = np.zeros(len(self))
        np.maximum.at(spread, of_tile, np.linalg.norm(self.rays - self.direction[of_tile], axis=1))
        longest = 2 * np.sin(self.opening / 4)
        width = longest + 2 * spread.max(initial=0)
        pairs = spatial.cKDTree(self.direction).query_pairs(width, output_type="ndarray")
        links = self._reaching(np.sort(pairs, axis=1)[:, ::-1], longest)
        _, seen_by = np.unique(self.ahead, axis=1, return_inverse=True)
        alike = seen_by.ravel()[links.one] == seen_by.ravel()[links.two]
        return links.take(alike), links.take(~alike)

    def _reaching(self, pairs: np.ndarray, longest: float) -> Links:
        """Links of those pairs of tiles (pair, 2) of which some rays are near each other."""
        sizes = np.diff(self.first)
        inside = np.minimum(np.arange(MOST_RAYS), sizes[:, None] - 1)
        d = self.rays[self.first[:-1, None] + inside]  # a last ray may stand more than once
        bits = np.where(np.arange(MOST_RAYS) < sizes[:, None], 1 << np.arange(MOST_RAYS), 0)
        pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
        reach = np.zeros((len(pairs), MOST_RAYS), np.uint32)
        for start in range(0, len(pairs), PAIRS):
            one, two = pairs[start : start + PAIRS].T
            near = 1 - np.einsum("pix,pjx->pij", d[one], d[two]) <= longest**2 / 2
            reach[start : start + PAIRS] = (near * bits[two][:, None]).sum(axis=2)
        linked = reach.any(axis=1)
        one, two = pairs[linked].T
        single = reach[linked].reshape(-1, GROUPS, 4)
        every = np.zeros((len(one), GROUPS, 16), np.uint32)
        for i in range(4):  # a subset with ray i is one without it, and ray i
            every[..., 1 << i : 2 << i] = every[..., : 1 << i] | single[..., i : i + 1]
        return Links(one, two, every)
