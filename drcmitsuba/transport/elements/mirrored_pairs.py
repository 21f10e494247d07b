"""Pairs of elements, of which one mirrors into the room what comes in by the other.

case, openings ─ MirroredPairs.of ─► pairs whose panes face each other
     ─ MirroredDeposit ───────────► S, D of every pair: images of suns, rays to the mirrored sky

A pair is lit with the product of the shares of its elements, as a path that meets two openings.
What two elements mirror in turn, and light of films and fabrics in the glass of another opening,
is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.model.materials import GlazingMaterial, SurfaceMaterial
from drcmitsuba.model.model import areas
from drcmitsuba.runtime.flat_arrays import repeated
from drcmitsuba.runtime.random_streams import Draw, Key, Stream, launch_seed, number_in_replicate
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.materials import lets_through
from drcmitsuba.scene.panes_in_state import GroupedPanes
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.elements.scenes import Element
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.mirrors.mirror_planes import COPLANAR
from drcmitsuba.transport.mirrors.planar_mirrors import PlanarMirrors
from drcmitsuba.transport.rays.openings import Within, repeated_within
from drcmitsuba.transport.rays.straight_suns import Disks

MOST_PAIRS = 32
"""Largest number of pairs, those of the largest panes; the others are left out."""
FEWER_RAYS = 4
"""Part of the rays to the sky that look for it in panes, which mirror little of it: 1 of so many.
"""


@dataclass(frozen=True)
class MirroredPairs:
    """Elements that mirror light, and those by which it comes in."""

    mirrors: tuple[int, ...] = ()
    passed: tuple[int, ...] = ()
    """Number of the mirroring element of every pair, and of the one that light passes."""
    left_out: int = 0
    """Number of pairs beyond `MOST_PAIRS`."""

    @classmethod
    def of(cls, panes: Sequence[GroupedPanes], first: Sequence[int]) -> MirroredPairs:
        """Find the pairs.

        Parameters
        ----------
        panes : sequence of GroupedPanes
        first : sequence of int, shape (opening,)
            First element of every opening.
        """
        found: dict[tuple[int, int], float] = {}
        for mirror, lit in product(panes, panes):
            if not _faces(mirror.quads, lit.quads):
                continue
            size = float(areas(mirror.quads).sum() * areas(lit.quads).sum())
            for (m, glass), (k, fill) in product(
                enumerate(mirror.materials), enumerate(lit.materials)
            ):
                # An opening has one fill at a time; its shares are those of fills side by side.
                if mirror.group == lit.group and m != k:
                    continue
                if _mirrors(glass) and _passes(fill):
                    pair = first[mirror.group] + m, first[lit.group] + k
                    found[pair] = found.get(pair, 0.0) + size
        order = sorted(found, key=lambda pair: (-found[pair], pair))
        kept = sorted(order[:MOST_PAIRS])
        mirrors, passed = zip(*kept, strict=True) if kept else ((), ())
        return cls(mirrors, passed, len(order) - len(kept))

    def __len__(self) -> int:
        """Count the pairs."""
        return len(self.mirrors)

    def joined(self, shares: np.ndarray) -> np.ndarray:
        """Shares (…, element) of all elements, followed by those of the pairs."""
        if not len(self):
            return shares
        of_pairs = shares[..., list(self.mirrors)] * shares[..., list(self.passed)]
        return np.concatenate([shares, of_pairs], axis=-1)


def _mirrors(fill: SurfaceMaterial | None) -> bool:
    return isinstance(fill, GlazingMaterial) and fill.reflectance > 0


def _passes(fill: SurfaceMaterial | None) -> bool:
    return fill is None or lets_through(fill)


def _faces(mirror: np.ndarray, lit: np.ndarray) -> bool:
    """Whether light by some of the quads `lit` may reach the front of some of another opening."""
    n, m = normals(mirror), normals(lit)
    p, q = mirror.reshape(-1, 3), lit.reshape(-1, 3)
    before_mirror = np.einsum("qi,pi->qp", n, q) - np.einsum("qi,qi->q", n, mirror[:, 0])[:, None]
    before_lit = np.einsum("qi,pi->qp", m, p) - np.einsum("qi,qi->q", m, lit[:, 0])[:, None]
    seen = (before_mirror.reshape(len(n), -1, 4) > COPLANAR).any(axis=2)
    shown = (before_lit.reshape(len(m), -1, 4) > COPLANAR).any(axis=2)
    return bool((seen & shown.T).any())


@dataclass(frozen=True)
class MirroredDeposit(Deposit):
    """Deposit of what panes mirror, and of no other light."""

    images: ImageSuns | None = None
    """Images in the panes of one element, in the light that another one lets in."""
    number: int = 0
    """Number of the pair, which has random numbers of its own."""

    @cached_property
    def mirrors(self) -> tuple[ImageSuns, ...]:
        """Light by way of the panes."""
        assert self.images is not None
        return (self.images,)

    def seed(self, key: Key, draw: Draw) -> int:
        """Seed of one launch, as `Deposit.seed`."""
        own = launch_seed(self.accuracy.seed, Stream.OPENINGS, self.number)
        return launch_seed(own, *key, draw)

    def by_sky(
        self, p: mi.Float, n: mi.Float, key: Key, rays: int, numbers: mi.UInt32 | None,
        within: Within,
    ) -> mi.TensorXf:  # fmt: skip
        """D by ground and sky in the panes, as `Deposit.by_sky`."""
        (images,), subdivision = self.mirrors, self.subdivision
        assert subdivision is not None
        with self.launch(key, Draw.SKY):
            seed = self.seed(key, Draw.MIRRORS)
            return images.sky(
                p, n, subdivision=subdivision, rays=max(1, rays // FEWER_RAYS), seed=seed,
                numbers=numbers, within=within,
            )  # fmt: skip

    def straight_on_sensors(
        self, p: mi.Float, n: mi.Float, places: mi.UInt32, replicates: range, sun_samples: int,
        within: Within = None, disks: Disks | None = None,
    ) -> Irradiance:  # fmt: skip
        """D on sensors, as `Deposit.straight_on_sensors`."""
        count, key, rays = len(replicates), (Stream.SENSORS,), self.accuracy.sensor_sky_rays
        numbers = dr.concat([number_in_replicate(places, r) for r in replicates])
        every = repeated(p, count), repeated(n, count)
        sky = self.by_sky(*every, key, rays, numbers, repeated_within(within, count))
        if sun_samples and len(self.suns):
            sun = self.mirrored_on_sensors(p, n, places, replicates, sun_samples, within)
            assert sun is not None
            return Irradiance(sky, sun)
        return Irradiance(sky, dr.zeros(mi.TensorXf, (dr.width(numbers), self.bins[1])))

    def _suns(
        self, p: mi.Float, n: mi.Float, key: Key, samples: int,
        numbers: mi.UInt32 | None = None, within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        """D by the suns themselves: none."""
        return dr.zeros(mi.TensorXf, (dr.width(p) // 3, self.bins[1]))


def elements_of_pairs(
    pairs: MirroredPairs, elements: Sequence[Element], panes: Sequence[GroupedPanes],
    first: Sequence[int], wanted: Mapping[int, np.ndarray] | None = None,
) -> list[Element]:  # fmt: skip
    """Light of pairs, whose numbers follow those of all elements.

    Parameters
    ----------
    elements : sequence of Element
        Elements that are asked for.
    first : sequence of int, shape (opening + 1,)
        First element of every opening, and the number of all.
    panes, wanted
        As for `elements_of_case`.
    """
    by_number, out = {each.number: each for each in elements}, []
    for k, (m, e) in enumerate(zip(pairs.mirrors, pairs.passed, strict=True)):
        mirror, lit, number = by_number.get(m), by_number.get(e), first[-1] + k
        if mirror is None or lit is None:
            continue
        if mirror.deposit is None or lit.deposit is None:
            out.append(Element(number, min(mirror.bins, lit.bins, key=len)))
            continue
        mine = [each.quads for each in panes if first[each.group] <= m < first[each.group + 1]]
        mirrors = PlanarMirrors.of_panes(mirror.deposit.scene, np.concatenate(mine))
        assert mirrors is not None
        base = lit.deposit
        sky, bins, suns = base.bins[0], lit.bins, base.suns
        if wanted is not None:
            kept = wanted[m][bins[sky:] - sky]
            bins, suns = np.concatenate([bins[:sky], bins[sky:][kept]]), suns[kept]
        light = MirroredDeposit(
            mirrors.scene, suns, base.diameter, base.subdivision, base.accuracy, None,
            images=ImageSuns(mirrors.scene, mirrors, base.scene), number=number,
        )  # fmt: skip
        out.append(Element(number, bins, light, lit.sun_samples, part=lit.part, is_mirrored=True))
    return out
