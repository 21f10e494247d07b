r"""Deposit by planar mirrors: images of the suns by exact geometry, and the mirrored sky.

Light that clear panes and smooth mirrors send on to a receiver before it meets anything else
(`planar_mirrors`) is part of D:

.. math:: D_b = \int \rho_1 \rho_2 \dots \tau V L_b(d') \cos\theta \, d\Omega(d)

with d' the direction d after the mirrors, ρ their reflectances at the incidence and τ V what panes
and obstructions between them let pass. A sun at s has the image R₁ R₂ … s, so directions d are
drawn from the image's disk: they meet mirrors, or not, as the outlines and what stands before and
behind them decide. For the sky, directions are drawn from the receiver's hemisphere.

Data flow: `ImageSuns.of(scene)` → `.suns(points, …)` and `.sky(points, …)`, shape (point, bin);
`ImageSuns.seen_from(p, …)`, the images that a place sees, serves eyes.
`transport.photons` leaves out what counts here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import TO_UNIT, random_bits
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import flat, flat_indices, row_and_column
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.mirrors.planar_mirrors import PlanarMirrors
from drcmitsuba.transport.rays.even_rays import first_directions
from drcmitsuba.transport.rays.openings import SLACK, Openings, Within
from drcmitsuba.transport.rays.shadow_rays import sun_deposit, sun_numbers, visibility
from drcmitsuba.transport.rays.sun_clusters import possible_pairs

MOST_SURFACES = 24
"""Largest number of panes and mirrors that a ray passes between two turns."""
FAINT_CHAIN, LEAST_DRAWN = 0.05, 1 / 8
"""Reflectance of a chain at normal incidence below which points that stand for a piece of a surface
draw directions to a share of the suns alone, and the least share [–]."""
MOST_TESTS = 64
"""Largest number of sequences of rectangles by which rays are tested before they are traced."""
FAINT = 1e-5
"""Weight below which rays end [–]."""
OFFSET = 1e-4
"""Distance from a surface at which a ray goes on, over its largest coordinate plus 1 m [–]."""
LEAST_COSINE = 0.1
"""Least cosine of the incidence for which it is kept [–]."""

Met = Callable[..., Any]
"""Takes the weight of mirrored light, the axis of the mirror, the ray after it and whether it is
one; gives what of the light counts."""


@dataclass(frozen=True)
class ImageSuns:
    """Light by way of the planar mirrors of a scene."""

    scene: Scene
    """Scene with the mirrors."""
    mirrors: PlanarMirrors
    beyond: Scene | None = None
    """Scene in which light reaches the last mirror of a chain; None for that of the mirrors."""

    @classmethod
    def of(cls, scene: Scene) -> ImageSuns | None:
        """Images in a scene; None without planar mirrors."""
        mirrors = PlanarMirrors.of(scene)
        return None if mirrors is None else cls(scene, mirrors)

    def suns(
        self, points: mi.Float, normals: mi.Float, *,
        suns: np.ndarray, diameter: float, samples: int, seed: int,
        numbers: mi.UInt32 | None = None, within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        """D of points by mirrored suns [sr], (point, sun); parameters as for `sun_deposit`.

        With 0 `samples`, one direction is drawn to suns in strong mirrors, and to a random share of
        the suns in faint ones.
        """
        count = dr.width(points) // 3
        out = dr.zeros(mi.Float, count * len(suns))
        if not count:
            return mi.TensorXf(out, (count, len(suns)))
        numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
        for i, chain in enumerate(self.mirrors.chains):
            images, may = self.mirrors.images(chain, suns)
            some = np.flatnonzero(may)
            if not len(some):
                continue
            openings = self.seen_first(chain)
            pairs = possible_pairs(openings, points, normals, images[some], diameter)
            share = 1.0 if samples else self._drawn_share(chain)
            if share < 1:
                pairs = drawn_pairs(pairs, share, numbers, images[some], seed + i)
            D = sun_deposit(
                self.scene, points, normals, suns=images[some], diameter=diameter,
                samples=max(1, samples), seed=seed + i, numbers=numbers,
                within=self.looks_out(within), through=partial(self._through, chain), pairs=pairs,
            )  # fmt: skip
            row, column = row_and_column(dr.arange(mi.UInt32, count * len(some)), len(some))
            sun = dr.gather(mi.UInt32, flat_indices(some), column)
            dr.scatter_add(out, D.array / share, row * dr.opaque(mi.UInt32, len(suns)) + sun)
            dr.eval(out)
        return mi.TensorXf(out, (count, len(suns)))

    @property
    def lit(self) -> Scene:
        """Scene in which suns and sky light the mirrors."""
        return self.scene if self.beyond is None else self.beyond

    def _drawn_share(self, chain: tuple[int, ...]) -> float:
        """Share of the suns to which a direction by a chain is drawn [–]."""
        rho = math.prod(float(self.mirrors.strongest[axis]) for axis in chain)
        return min(1.0, max(LEAST_DRAWN, rho / FAINT_CHAIN))

    def sky(
        self, points: mi.Float, normals: mi.Float, *,
        subdivision: int, rays: int, seed: int, numbers: mi.UInt32 | None = None,
        within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        """D of points by mirrored ground and sky patches [sr], (point, bin), as `sky_deposit`."""
        bins, count = len(Patches(subdivision)), dr.width(points) // 3
        out = dr.zeros(mi.Float64, count * bins)
        numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
        share, stride = dr.opaque(mi.Float, np.pi / rays), dr.opaque(mi.UInt32, bins)
        for row, _, p, d in self.towards_mirrors(points, normals, rays, seed, numbers, within):
            met = _MirroredSky(self, row * stride, subdivision, out)
            dr.eval(self.followed(p, d, dr.full(mi.Bool, True, dr.width(row)), share, met), out)
        return mi.TensorXf(mi.Float(out), (count, bins))

    def towards_mirrors(
        self, points: mi.Float, normals: mi.Float, rays: int, seed: int, numbers: mi.UInt32,
        within: Within,
    ) -> Iterator[tuple[mi.UInt32, mi.UInt32, mi.Point3f, mi.Vector3f]]:  # fmt: skip
        """Yield rays from points in which, were nothing before them, a mirror is seen.

        They are the point, the number of its ray, its place and the direction.
        """
        every = Openings(np.concatenate(self.mirrors.seen))
        openings = Openings.of(self.scene, points, self.looks_out(within))
        count = dr.width(points) // 3
        block = max(1, SHADOW_RAYS // rays)
        for start in range(0, count, block):
            lane = dr.arange(mi.UInt32, min(block, count - start) * rays)
            row, ray = row_and_column(lane, rays)
            row += dr.opaque(mi.UInt32, start)
            p = dr.gather(mi.Point3f, points, row)
            frame = mi.Frame3f(dr.gather(mi.Normal3f, normals, row))
            d = frame.to_world(first_directions(ray, dr.gather(mi.UInt32, numbers, row), seed))
            passed = every.passed(row, p, d)
            if openings is not None:
                passed &= openings.passed(row, p, d)
            kept = dr.compress(passed)
            if dr.width(kept):
                row, ray, p, d = (dr.gather(type(x), x, kept) for x in (row, ray, p, d))
                dr.eval(row, ray, p, d)
                yield row, ray, p, d

    def seen_from(
        self, p: mi.Point3f, suns: np.ndarray, diameter: float, sides: Sequence[np.ndarray]
    ) -> Iterator[tuple[np.ndarray, np.ndarray, Callable[[mi.Vector3f], mi.Float]]]:
        """Yield the images of suns that a place may see, chain by chain.

        Parameters
        ----------
        p : mi.Point3f
            Place [m].
        suns : np.ndarray, shape (sun, 3)
            Unit vectors to the suns.
        diameter : float
            Angle across a sun [deg].
        sides : sequence of np.ndarray, by axis
            Rectangles in which images are looked for, `PlanarMirrors.seen` or `.rectangles`.

        Yields
        ------
        directions : np.ndarray, shape (image, 3)
            Unit vectors to the images.
        which : np.ndarray of int, shape (image,)
            Indices of their suns.
        reached : callable
            Gives the share of light [–] that reaches the place from directions.
        """
        for chain in self.mirrors.chains:
            d, may = self.mirrors.images(chain, suns)
            every = dr.arange(mi.UInt32, len(d))
            towards = dr.gather(mi.Vector3f, flat(d), every)
            spread = dr.opaque(mi.Float, np.radians(diameter) / 2)
            may &= Openings(sides[chain[0]]).passed(every, p, towards, spread).numpy()
            if len(some := np.flatnonzero(may)):

                def reached(d: mi.Vector3f, chain: tuple[int, ...] = chain) -> mi.Float:
                    return self.reached(chain, p, d, dr.full(mi.Bool, True, dr.width(d)))

                yield d[some], some, reached

    def seen_first(self, chain: tuple[int, ...]) -> Openings:
        """Mirrors of a chain that receivers look into, as openings."""
        return Openings(self.mirrors.seen[chain[0]])

    def looks_out(self, within: Within) -> Within:
        """Whether receivers see mirrors by the openings of their room alone, as `within`.

        Panes are openings, other mirrors may stand in the room.
        """
        if not self.mirrors.has_bodies:
            return within
        room = self.scene.enclosure
        return False if room is not None and room.is_box else None

    def _through(
        self, chain: tuple[int, ...], scene: Scene, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool
    ) -> mi.Float:
        """`reached` as `shadow_rays.Through`."""
        scene.ray_counter.add("shadow", active, dr.width(d))
        return self.reached(chain, p, d, active)

    @cached_property
    def has_blocked_windows(self) -> bool:
        """Whether `windows.deposit` has blocked windows, which `Scene.full` does not hold."""
        scene = self.scene
        clear = 0 if scene.clear is None else len(scene.clear.shapes())
        return len(scene.opaque.shapes()) + clear > len(scene.full.shapes())

    def _blocked(
        self, p: mi.Point3f, d: mi.Vector3f, mirror: mi.Point3f, active: mi.Bool
    ) -> mi.Bool:
        """Whether anything opaque stands between points and a mirror."""
        way = mi.Ray3f(p, d, dr.dot(mirror - p, d) * (1 - 1e-4), 0, [])
        return self.scene.opaque.ray_test(way, coherent=False, active=active)

    def reached(
        self, chain: tuple[int, ...], p: mi.Point3f, d: mi.Vector3f, active: mi.Bool
    ) -> mi.Float:
        """Share of light [–] that reaches points from directions d by the mirrors of a chain."""
        if math.prod(len(self.mirrors.rectangles[axis]) // 2 for axis in chain) <= MOST_TESTS:
            active = active & self._may_take(chain, p, d)
        return self.followed(p, d, active, mi.Float(1), _InTurn(self, chain))

    def _may_take(self, chain: tuple[int, ...], p: mi.Point3f, d: mi.Vector3f) -> mi.Bool:
        """Whether rays meet a rectangle of each axis of a chain in turn, were nothing else there.

        It spares the tracing of most rays to two mirrors in turn.
        """
        every, may = Openings(self.mirrors.rectangles[chain[0]][::2]), mi.Bool(False)
        for i in range(len(every.quads)):
            corner, n, *sides, length = every.axes(i)
            t = dr.dot(corner - p, n) / dr.dot(d, n)
            at, meets = p + t * d, t > 0
            for side, most in zip(sides, length.xy, strict=True):
                place = dr.dot(at - corner, side)
                meets &= (place > -SLACK) & (place < most + SLACK)
            if len(chain) > 1:
                meets &= self._may_take(chain[1:], at, d - 2 * dr.dot(d, n) * n)
            may |= meets
        return may

    @symbolic
    def followed(
        self, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool, weight: mi.Float, met: Met
    ) -> mi.Float:
        """Σ of what counts of the light that mirrors along rays send to points.

        Rays go straight through clear panes, each of which may mirror as well.
        """
        total, weight, active = mi.Float(0), mi.Float(weight), mi.Bool(active)
        ray, step = mi.Ray3f(p, d), mi.UInt32(0)
        faces = self.scene.met_faces
        while dr.hint(active, exclude=[self, met, faces, p, d]):
            si = faces.intersect(self.scene.full, ray, active)
            active &= si.is_valid()
            axis, rho = self.mirrors.met(si, si.wi.z, active)
            onward, mirrors = ray.d + 2 * si.wi.z * si.n, active & (rho > 0)
            if dr.hint(self.has_blocked_windows, mode="scalar"):
                mirrors &= ~self._blocked(p, d, si.p, mirrors)
            total += met(weight * rho, axis, _ray_on(si, onward), mirrors)
            weight *= si.bsdf().eval_null_transmission(si, active)[0]
            ray = _ray_on(si, ray.d)
            step += 1
            active &= (weight > FAINT) & (step < MOST_SURFACES)
        return total


def drawn_pairs(
    pairs: Iterable[mi.UInt32], share: float, numbers: mi.UInt32, suns: np.ndarray, seed: int
) -> Iterator[mi.UInt32]:
    """Yield a random share of pairs point · suns + sun; parameters as for `sun_deposit`."""
    places = flat_indices(sun_numbers(suns))
    for pair in pairs:
        row, sun = row_and_column(pair, len(suns))
        number, place = dr.gather(mi.UInt32, numbers, row), dr.gather(mi.UInt32, places, sun)
        bits = random_bits(number, ~seed, place)[0]  # `seed` draws the directions
        chosen = dr.compress(mi.Float(bits >> 8) * TO_UNIT < dr.opaque(mi.Float, share))
        if dr.width(chosen):
            yield dr.gather(mi.UInt32, pair, chosen)


def _ray_on(si: mi.SurfaceInteraction3f, d: mi.Vector3f) -> mi.Ray3f:
    """Ray from a surface, off it along itself.

    Off it along the normal, as `spawn_ray` has it, a ray would go on some tenths of a millimetre
    aside: at a frame 1 m away that is a thirtieth of a sun's disk.
    """
    far = OFFSET * (1 + dr.max(dr.abs(si.p))) / dr.maximum(dr.abs(dr.dot(si.n, d)), LEAST_COSINE)
    return mi.Ray3f(si.p + far * d, d)


@dataclass(frozen=True)
class _InTurn:
    """Counts light from the direction of a sun after all mirrors of a chain."""

    images: ImageSuns
    chain: tuple[int, ...]

    def __call__(
        self, weight: mi.Float, axis: mi.UInt32, ray: mi.Ray3f, active: mi.Bool
    ) -> mi.Float:
        """Light that counts, as `Met`."""
        active &= axis == self.chain[0]
        if len(self.chain) == 1:
            reached = weight * visibility(self.images.lit, ray, active)
        else:
            rest = _InTurn(self.images, self.chain[1:])
            reached = self.images.followed(ray.o, ray.d, active, weight, rest)
        return dr.select(active, reached, 0)


@dataclass(frozen=True)
class _MirroredSky:
    """Adds light of ground and sky patches, after one mirror and after several in turn."""

    images: ImageSuns
    first: mi.UInt32
    """First entry of each ray's receiver in `out`."""
    subdivision: int
    out: mi.Float64
    turns: int = 1

    def __call__(
        self, weight: mi.Float, axis: mi.UInt32, ray: mi.Ray3f, active: mi.Bool
    ) -> mi.Float:
        """Add the light; nothing of it counts once more."""
        scene = self.images.lit
        lit = active & scene.effects.shines(ray.d)
        light = weight * visibility(scene, ray, lit)
        entry = self.first + patch_index(ray.d, self.subdivision)
        dr.scatter_add(self.out, mi.Float64(light), entry, lit & (light > 0))
        if self.turns < self.images.mirrors.most_in_turn:
            rest = _MirroredSky(self.images, self.first, self.subdivision, self.out, self.turns + 1)
            return self.images.followed(ray.o, ray.d, active, weight, rest)
        return mi.Float(0)
