"""Deposit D: irradiance of receivers by sky, ground and suns before any diffuse reflection.

`Deposit` joins straight light, by shadow rays, and light by way of scattering panes. Sky and suns
are two arrays, since they reach different receivers.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.flat_arrays import repeated
from drcmitsuba.runtime.random_streams import (
    Draw,
    Key,
    Stream,
    launch_seed,
    number_in_replicate,
)
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.films.films import EvenRows, Films, LitFilms
from drcmitsuba.transport.films.looks import Looked
from drcmitsuba.transport.films.peaks import peak_deposit
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.mirrors.sun_lobes import SunLobes
from drcmitsuba.transport.panes.acceptance import Acceptance
from drcmitsuba.transport.panes.patches import PanePatches, patch_sizes
from drcmitsuba.transport.panes.transfer import neumann_series, pane_transfer
from drcmitsuba.transport.rays.even_rays import Starts
from drcmitsuba.transport.rays.openings import Within, repeated_within, within_of
from drcmitsuba.transport.rays.shadow_rays import Accepts, sky_deposit, sun_deposit
from drcmitsuba.transport.rays.straight_suns import FEWER, Disks

PEAK_RAYS = 8
"""Largest number of directions along the peaks of a film per pane point of a receiver."""
TO_PANES = frozenset({Draw.PANES, Draw.FILMS, Draw.PEAKS})
"""Draws of points on panes, and of directions to them."""
ON_SENSORS, ON_CELLS = 16, 32
"""A sensor, and a cell, draw a direction from the lobe of a sun for so many of its pane points."""


@dataclass(frozen=True)
class Deposit:
    """Deposit on any receivers, in one replicate.

    Methods take the receivers' positions [m] and normals, three numbers each, the stream of their
    random numbers with its indices, and optionally `numbers`, see `shadow_rays.sky_deposit`.
    """

    scene: Scene
    suns: np.ndarray
    """Unit vectors, shape (sun, 3)."""
    diameter: float
    """Angle across a sun [deg]."""
    subdivision: int | None
    """Reinhart's factor MF of the sky; None leaves out ground and sky."""
    accuracy: Accuracy
    patches: PanePatches | None
    """Patches of the panes that scatter evenly."""
    films: Films | None = None
    """Panes with a measured BSDF."""
    faces: Irradiance | None = None
    """E on the faces of `patches`; see `lit`."""
    on_films: LitFilms | None = None
    """D on the films, and the radiance that they send on."""
    accepts: Accepts | None = None
    """Share of straight light that counts at the receivers; None where all of it does."""
    starts: Starts | None = None
    """Where rays of straight light start from receivers that are surfaces."""
    pane_seed: int | None = None
    """Seed of the draws `TO_PANES`; None for that of the case."""

    @classmethod
    def of(
        cls, scene: Scene, suns: np.ndarray, diameter: float, subdivision: int | None,
        accuracy: Accuracy,
    ) -> Deposit:  # fmt: skip
        """Deposit in a scene, whose panes are cut into patches of at most two cells' width."""
        panes, size = scene.scattering, 2 * accuracy.cell_size
        sizes = patch_sizes(panes, scene.corners, size)
        patches = PanePatches.of([pane.quads for pane in panes], sizes) if panes else None
        films = Films.of(scene, size, suns, diameter)
        return cls(scene, suns, diameter, subdivision, accuracy, patches, films)

    @property
    def bins(self) -> tuple[int, int]:
        """Number of sky bins, including the ground, and of suns."""
        return len(Patches(self.subdivision)) if self.subdivision else 0, len(self.suns)

    def seed(self, key: Key, draw: Draw) -> int:
        """Seed of one launch."""
        own = self.pane_seed if draw in TO_PANES else None
        return launch_seed(self.accuracy.seed if own is None else own, *key, draw)

    @contextmanager
    def launch(self, key: Key, draw: Draw) -> Iterator[int]:
        """Give the seed of one launch, and count its rays by the stream and the draw."""
        with self.scene.ray_counter.purpose(key[0].name, draw.name):
            yield self.seed(key, draw)

    def straight(
        self, p: mi.Float, n: mi.Float, key: Key, sky_rays: int, sun_samples: int = 1,
        numbers: mi.UInt32 | None = None, within: Within = None,
    ) -> Irradiance:  # fmt: skip
        """D by straight light, with 0 `sun_samples` without the suns.

        Light that planar mirrors and panes send to the receivers counts with it.
        """
        sky = self.by_sky(p, n, key, sky_rays, numbers, within)
        if not sun_samples:
            return Irradiance(sky, dr.zeros(mi.TensorXf, (dr.width(p) // 3, self.bins[1])))
        sun = self._suns(p, n, key, sun_samples, numbers, within)
        mirrored = self._mirrored_suns(p, n, key, sun_samples, numbers, within)
        return Irradiance(sky, sun if mirrored is None else sun + mirrored)

    def straight_on_sensors(
        self, p: mi.Float, n: mi.Float, places: mi.UInt32, replicates: range, sun_samples: int,
        within: Within = None, disks: Disks | None = None,
    ) -> Irradiance:  # fmt: skip
        """D by straight light on sensors in some replicates, shape (replicate · sensor, bin) each.

        Parameters
        ----------
        p, n, within
            As for `straight`.
        places : mi.UInt32
            Numbers of the sensors among all sensors.
        sun_samples : int
            Directions on a sun that a shadow's edge crosses, see `straight_suns`; with 0, suns are
            left out.
        disks : Disks, optional
            From `disks` of these sensors, whose edges are then looked for once for all replicates.
        """
        count, key, rays = len(replicates), (Stream.SENSORS,), self.accuracy.sensor_sky_rays
        numbers = dr.concat([number_in_replicate(places, r) for r in replicates])
        every_p, every_n = repeated(p, count), repeated(n, count)
        every_within = repeated_within(within, count)
        sky = self.by_sky(every_p, every_n, key, rays, numbers, every_within)
        if not sun_samples or not len(self.suns):
            return Irradiance(sky, dr.zeros(mi.TensorXf, (dr.width(numbers), self.bins[1])))
        disks = self.disks(p, n, places, within) if disks is None else disks
        with self.scene.ray_counter.purpose(Stream.SENSORS.name, Draw.SUN.name):
            sun = disks.by_replicate(replicates, sun_samples)
        mirrored = self.mirrored_on_sensors(p, n, places, replicates, sun_samples, within)
        return Irradiance(sky, sun if mirrored is None else sun + mirrored)

    def mirrored_on_sensors(
        self, p: mi.Float, n: mi.Float, places: mi.UInt32, replicates: range, sun_samples: int,
        within: Within = None,
    ) -> mi.TensorXf | None:  # fmt: skip
        """D by suns in mirrors, with arguments of `straight_on_sensors`; None without mirrors.

        The shape is (replicate · sensor, sun).
        """
        if not self.mirrors:
            return None
        count = len(replicates)
        fewer = max(self.accuracy.mirrored_sun_samples, sun_samples // FEWER)
        numbers = dr.concat([number_in_replicate(places, r) for r in replicates])
        return self._mirrored_suns(
            repeated(p, count), repeated(n, count), (Stream.SENSORS,), fewer, numbers,
            repeated_within(within, count),
        )  # fmt: skip

    @cached_property
    def _faces_within(self) -> Within:
        """Whether the points of both faces of the scattering panes lie in the room."""
        assert self.patches is not None
        return within_of(self.scene, self.patches.corners_of_faces)

    @cached_property
    def _films_within(self) -> Within:
        """Whether the points of both faces of the films lie in the room."""
        assert self.films is not None
        return within_of(self.scene, self.films.patches.corners_of_faces)

    @cached_property
    def mirrors(self) -> tuple[ImageSuns | SunLobes, ...]:
        """Light by way of smooth and of rough mirrors."""
        images = ImageSuns.of(self.scene)
        return (*(() if images is None else (images,)), *SunLobes.of(self.scene))

    def disks(self, p: mi.Float, n: mi.Float, places: mi.UInt32, within: Within) -> Disks:
        """Disks of the suns as sensors see them, the same in all replicates."""
        return Disks(self.scene, self.suns, self.diameter, self.accuracy, p, n, places, within)

    def by_sky(
        self, p: mi.Float, n: mi.Float, key: Key, rays: int, numbers: mi.UInt32 | None,
        within: Within,
    ) -> mi.TensorXf:  # fmt: skip
        """D by ground and sky, straight and by planar mirrors; as `straight`."""
        if not self.subdivision:
            return dr.zeros(mi.TensorXf, (dr.width(p) // 3, 0))
        kind: dict[str, Any] = {"subdivision": self.subdivision, "rays": rays, "numbers": numbers}
        with self.launch(key, Draw.SKY) as seed:
            sky = sky_deposit(
                self.scene, p, n, seed=seed, within=within, accepts=self.accepts,
                starts=self.starts, **kind,
            )  # fmt: skip
        seed = self.seed(key, Draw.MIRRORS)
        with self.scene.ray_counter.purpose(key[0].name, Draw.SKY.name):
            for each in self.mirrors:
                sky += each.sky(p, n, seed=seed, within=within, **kind)
        return sky

    def _mirrored_suns(
        self, p: mi.Float, n: mi.Float, key: Key, samples: int, numbers: mi.UInt32 | None,
        within: Within,
    ) -> mi.TensorXf | None:  # fmt: skip
        """D by suns in planar and in rough mirrors; None without such mirrors."""
        kind: dict[str, Any] = {
            "suns": self.suns, "diameter": self.diameter, "numbers": numbers, "within": within,
            "seed": self.seed(key, Draw.MIRRORS),
        }  # fmt: skip
        points = self.accuracy.pane_points  # as for films: most directions miss the mirror
        lobes = max(1, points // (ON_SENSORS if key[0] is Stream.SENSORS else ON_CELLS))
        samples = 0 if key[0] is Stream.CELLS else samples  # a cell is one of many
        with self.scene.ray_counter.purpose(key[0].name, Draw.SUN.name):
            parts = [
                each.suns(p, n, samples=lobes if isinstance(each, SunLobes) else samples, **kind)
                for each in self.mirrors
            ]
        return sum(parts[1:], parts[0]) if parts else None

    def _suns(
        self, p: mi.Float, n: mi.Float, key: Key, samples: int,
        numbers: mi.UInt32 | None = None, within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        with self.launch(key, Draw.SUN) as seed:
            return sun_deposit(
                self.scene, p, n, suns=self.suns, diameter=self.diameter, samples=samples,
                seed=seed, numbers=numbers, within=within, accepts=self.accepts,
                starts=self.starts,
            )  # fmt: skip

    def onto_panes(self, p: mi.Float, n: mi.Float, key: Key, within: Within = None) -> Irradiance:
        """D by straight light on the faces of diffusing panes, outer ones by their `Acceptance`.

        Each ray starts at a point of its own: behind a reveal, light differs over a face. Light by
        way of mirrors falls on the points p, and counts as light from everywhere alike.
        """
        assert self.patches is not None
        materials = [pane.material for pane in self.scene.scattering]
        accepted = Acceptance.of(materials, self.patches.owner)  # type: ignore[arg-type]
        accepts = None if accepted is None else accepted.at
        deposit = replace(self, accepts=accepts, starts=self.patches.on_faces)
        return deposit.straight(p, n, key, 4 * self.accuracy.cell_sky_rays, within=within)

    def transfer(
        self, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None = None,
        within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        """K from the faces of the panes to receivers, shape (receiver, face)."""
        assert self.patches is not None
        with self.launch(key, Draw.PANES) as seed:
            return pane_transfer(
                self.scene, self.patches, p, n,
                rays=self.accuracy.pane_points, seed=seed, numbers=numbers, within=within,
            )  # fmt: skip

    def lit(self, replicate: int) -> Deposit:
        """Compute `faces` and `on_films`, the light on the panes, in a replicate.

        Light from one film to another, or from a diffusing pane to a film, is not followed
        here, but by `photons`.
        """
        key: Key = (Stream.PANES, replicate)
        films = self._with_films_lit((Stream.FILMS, replicate))
        if films.patches is None:
            return films
        p, n = films.patches.face_points(np.random.default_rng(self.seed(key, Draw.POINTS)))
        within = self._faces_within
        received = films.onto_panes(p, n, key, within)
        received = received.plus(
            films.by_films(p, n, (Stream.FILMS_TO_PANES, replicate), within=within)
        )
        between = films.transfer(p, n, key, within=within)
        faces = Irradiance(*(neumann_series(between, part) for part in received))
        return replace(films, faces=faces)

    def _with_films_lit(self, key: Key) -> Deposit:
        if self.films is None:
            return self
        p, n = self.films.patches.face_points(np.random.default_rng(self.seed(key, Draw.POINTS)))
        spread = replace(self, starts=self.films.patches.on_faces)
        sun = spread._suns(p, n, key, 1, within=self._films_within)
        seed = self.seed(key, Draw.SUN_ANSWER)
        to_suns = self.films.answer_to_suns(seed)
        samples = self.accuracy.film_sky_samples
        with self.launch(key, Draw.SKY) as seed:
            to_sky = self.films.answer_to_sky(self.subdivision, samples, seed)
        to_suns, peaks = self.films.without_peaks(to_suns)
        return replace(self, on_films=LitFilms(sun, to_suns, to_sky, peaks))

    def by_films(
        self, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None = None,
        within: Within = None,
    ) -> Irradiance | None:  # fmt: skip
        """D by way of films; None without films, or where they are not lit."""
        if self.on_films is None:
            return None
        return self.by_looked(self.looked(p, n, key, numbers, within), p, n, key, numbers)

    def looked(
        self, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None = None,
        within: Within = None,
    ) -> Looked:  # fmt: skip
        """Directions from receivers to films."""
        assert self.films is not None
        with self.launch(key, Draw.FILMS) as seed:
            rays = self.accuracy.pane_points
            return self.films.looked(p, n, rays=rays, seed=seed, numbers=numbers, within=within)

    def by_looked(
        self, looked: Looked, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None,
        among: np.ndarray | None = None, without: tuple[EvenRows, ...] = (),
    ) -> Irradiance:  # fmt: skip
        """D by way of the patches of films in a mask (patch,), by default all of them.

        The narrow peaks of a film count with its first patch. Films `without` their light are left
        to the caller, see `Films.sent`.
        """
        assert self.films is not None
        assert self.on_films is not None
        owner, most = self.films.patches.owner, PEAK_RAYS * self.accuracy.pane_points
        looked = looked if among is None else looked.of(among)
        sky, sun = self.films.sent(looked, self.on_films, without)
        with self.launch(key, Draw.PEAKS) as seed:
            for peaks in self.on_films.peaks:
                if among is not None and not among[np.argmax(owner == peaks.owner)]:
                    continue
                sun += peak_deposit(
                    self.scene, self.films.patches, self.films.mounts[peaks.owner], peaks, p, n,
                    suns=self.suns, diameter=self.diameter, most=most, seed=seed, numbers=numbers,
                )  # fmt: skip
        return Irradiance(sky, sun)

    def scattered(
        self, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None = None
    ) -> Irradiance | None:
        """D by way of scattering panes; None without such panes."""
        films = self.by_films(p, n, key, numbers)
        if self.faces is None:
            return films
        transfer = self.transfer(p, n, key, numbers)
        return Irradiance(*(transfer @ part for part in self.faces)).plus(films)
