"""Deposit of what the panes of one element mirror of the light that another one lets in.

Suns have images in the panes, and rays look for the mirrored sky, for fabrics and for films.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import drjit as dr
import mitsuba as mi

from drcmitsuba.runtime.flat_arrays import repeated
from drcmitsuba.runtime.random_streams import Draw, Key, Stream, launch_seed, number_in_replicate
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.elements.mirrored_looks import looks_by_mirrors
from drcmitsuba.transport.films.looks import Looked
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.panes.patches import PanePatches
from drcmitsuba.transport.panes.transfer import PaneLook, transfer_by
from drcmitsuba.transport.rays.openings import Within, repeated_within
from drcmitsuba.transport.rays.straight_suns import Disks

FEWER_RAYS = 4
"""Number of rays to the sky for each one that looks for it in panes, which mirror little."""


@dataclass(frozen=True)
class MirroredDeposit(Deposit):
    """Deposit of what panes mirror, and of no other light."""

    images: ImageSuns | None = None
    """Images in the panes of one element, in the light that another one lets in."""
    base: Deposit | None = None
    """Deposit of that element."""
    is_clear: bool = True
    """Whether light comes straight by it."""
    number: int = 0
    """Number of the pair, which has random numbers of its own."""

    @classmethod
    def shown(
        cls, images: ImageSuns, base: Deposit, number: int, is_clear: bool
    ) -> MirroredDeposit:
        """Deposit of what mirrors show of the light of an element."""
        return cls(
            images.scene, base.suns, base.diameter, base.subdivision, base.accuracy, base.patches,
            base.films, images=images, base=base, number=number, is_clear=is_clear,
        )  # fmt: skip

    @cached_property
    def mirrors(self) -> tuple[ImageSuns, ...]:
        """Light by way of the panes, if any comes straight."""
        assert self.images is not None
        return (self.images,) if self.is_clear else ()

    def seed(self, key: Key, draw: Draw) -> int:
        """Seed of one launch, as `Deposit.seed`."""
        own = launch_seed(self.accuracy.seed, Stream.OPENINGS, self.number)
        return launch_seed(own, *key, draw)

    def by_sky(
        self, p: mi.Float, n: mi.Float, key: Key, rays: int, numbers: mi.UInt32 | None,
        within: Within,
    ) -> mi.TensorXf:  # fmt: skip
        """D by ground and sky in the panes, as `Deposit.by_sky`."""
        assert self.subdivision is not None
        sky = dr.zeros(mi.TensorXf, (dr.width(p) // 3, self.bins[0]))
        with self.launch(key, Draw.SKY):
            for images in self.mirrors:
                sky = images.sky(
                    p, n, subdivision=self.subdivision, rays=max(1, rays // FEWER_RAYS),
                    seed=self.seed(key, Draw.MIRRORS), numbers=numbers, within=within,
                )  # fmt: skip
        return sky

    def straight_on_sensors(
        self, p: mi.Float, n: mi.Float, places: mi.UInt32, replicates: range, sun_samples: int,
        within: Within = None, disks: Disks | None = None,
    ) -> Irradiance:  # fmt: skip
        """D on sensors, as `Deposit.straight_on_sensors`."""
        count, key, rays = len(replicates), (Stream.SENSORS,), self.accuracy.sensor_sky_rays
        numbers = dr.concat([number_in_replicate(places, r) for r in replicates])
        every = repeated(p, count), repeated(n, count)
        sky = self.by_sky(*every, key, rays, numbers, repeated_within(within, count))
        sun = None
        if sun_samples and len(self.suns):
            sun = self.mirrored_on_sensors(p, n, places, replicates, sun_samples, within)
        if sun is None:
            sun = dr.zeros(mi.TensorXf, (dr.width(numbers), self.bins[1]))
        return Irradiance(sky, sun)

    def lit(self, replicate: int) -> MirroredDeposit:
        """Light on the panes of the element that is mirrored, as `Deposit.lit`."""
        assert self.base is not None
        lit, on_films = self.base.lit(replicate), None
        if lit.on_films is not None:
            on_films = lit.on_films._replace(peaks=())
        return replace(self, faces=lit.faces, on_films=on_films)

    def transfer(
        self, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None = None,
        within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        """K from the faces of the panes by way of the mirrors, as `Deposit.transfer`."""
        assert self.patches is not None
        assert self.images is not None
        every, _ = self._looks(self.patches, p, n, key, Draw.PANES, numbers, within)
        return transfer_by(every, self.images.lit, self.patches, dr.width(p) // 3)

    def looked(
        self, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None = None,
        within: Within = None,
    ) -> Looked:  # fmt: skip
        """Directions from receivers to films by way of the mirrors, as `Deposit.looked`."""
        assert self.films is not None
        every, rays = self._looks(self.films.patches, p, n, key, Draw.FILMS, numbers, within)
        return self.films.looked_along(every, dr.width(p) // 3, rays)

    def _looks(
        self, patches: PanePatches, p: mi.Float, n: mi.Float, key: Key, draw: Draw,
        numbers: mi.UInt32 | None, within: Within,
    ) -> tuple[list[PaneLook], int]:  # fmt: skip
        """Directions to patches in the mirrors, and how many of them are drawn at a receiver."""
        assert self.images is not None
        accuracy, on_sensors = self.accuracy, key[0] is Stream.SENSORS
        sky_rays = accuracy.sensor_sky_rays // FEWER_RAYS if on_sensors else accuracy.cell_sky_rays
        rays = max(accuracy.pane_points, sky_rays)
        numbers = dr.arange(mi.UInt32, dr.width(p) // 3) if numbers is None else numbers
        with self.launch(key, draw) as seed:
            every = looks_by_mirrors(
                self.images, patches, p, n, rays=rays, seed=seed, numbers=numbers, within=within
            )
        return every, rays

    def _suns(
        self, p: mi.Float, n: mi.Float, key: Key, samples: int,
        numbers: mi.UInt32 | None = None, within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        """D by the suns themselves: none."""
        return dr.zeros(mi.TensorXf, (dr.width(p) // 3, self.bins[1]))
