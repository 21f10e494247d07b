r"""Paths of the rays of an eye: through panes, and by way of mirrors and solids, to their ends.

The luminance that an eye sees along a ray is

.. math:: L = \sum_e w_e L_e

with the weight w [–] and the luminance of every end e: the outside, a pane that scatters, a rough
mirror under the suns, a surface that reflects diffusely. Rays go straight on through clear panes,
gaps and straight-through peaks, with the transmittance for a weight, whatever else becomes of
them. Beside that, a surface turns rays, or reflects diffusely, or both. Rays above a weight go all
of these ways. Of fainter ones, a turn or an end is drawn on their way straight on: with the shares
τ (straight), t (turned), ρ (diffuse) of its surface k, those there with the probabilities

.. math:: c_k \frac{t_k, \rho_k}{\tau_k + t_k + \rho_k}, \qquad
    c_{k+1} = c_k \frac{\tau_k}{\tau_k + t_k + \rho_k},

so that a ray ends at one surface at most, and at a rate by what it gets there.

All rays of a launch go from surface to surface together. A ray's random numbers follow from its
number and its turns alone.

Limits: of a solid's faces, and of the lobe of a rough mirror, one direction is drawn.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.sampling import TO_UNIT, random_bits

from drcmitsuba.eye.ends import OUTSIDE, Ends, EyeEnds, OnWay, joined, taken
from drcmitsuba.eye.mirrored_sun import MirroredSun
from drcmitsuba.eye.openings import NO_OPENING, SeenOpenings
from drcmitsuba.eye.optics import EyeOptics, MetSurface, SurfaceKind
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.mirrors.image_suns import OFFSET, ImageSuns
from drcmitsuba.transport.rays.bsdf_lookup import absorption, absorption_after, share_left

MOST_SURFACES = 64
"""Largest number of surfaces on a ray's way."""
LEAST_WEIGHT = 1e-5
"""Weight below which a ray ends that goes straight on [–]."""
DRAWN = float("inf")
"""In place of the weight from which rays go all ways: none does."""
_APART = 0x9E3779B1


class _Rays(NamedTuple):
    """Rays on their way."""

    ray: mi.UInt32
    number: mi.UInt32
    place: mi.UInt32
    """Number of the way so far, from which random numbers follow."""
    choice: mi.Float
    """Uniform number that draws where a ray turns or ends on its way straight on."""
    used: mi.Float
    """Its part that stands for ways that other surfaces had to offer."""
    chance: mi.Float
    """Probability c with which none of these was drawn."""
    weight: mi.Float
    o: mi.Point3f
    d: mi.Vector3f
    turns: mi.UInt32
    """Turns at mirrors, see `mirrored_sun`."""
    lobe: mi.Float
    met: mi.UInt32
    inside: mi.Float
    """Absorption of the solid that the ray is in [1/m]."""
    opening: mi.Int32
    again: mi.Bool


@dataclass(frozen=True, eq=False)
class EyePaths:
    """Follows rays of eyes through a scene."""

    scene: Scene
    sun: MirroredSun
    """Mirrors of the scene, and how they show the sun."""
    optics: EyeOptics
    openings: SeenOpenings | None = None
    """Openings that rays note."""
    all_ways: float = DRAWN
    """Weight from which rays go all ways that a surface offers [–]."""

    @classmethod
    def of(
        cls, scene: Scene, diameter: float, openings: SeenOpenings | None = None,
        all_ways: float = DRAWN,
    ) -> EyePaths:  # fmt: skip
        """Prepare a scene under suns of an angle across [deg]; else as the fields."""
        sun = MirroredSun.of(scene, ImageSuns.of(scene), diameter)
        return cls(scene, sun, EyeOptics.of(scene), openings, all_ways)

    def ends(
        self, p: mi.Point3f, d: mi.Vector3f, lane: mi.UInt32, samples: int, seed: int
    ) -> EyeEnds:
        """Follow rays to their ends.

        Parameters
        ----------
        p, d
            Places of eyes [m], one or one for each ray, and unit vectors, shape (ray,).
        lane : mi.UInt32, shape (ray,)
            Numbers of the rays, from which their random numbers follow.
        samples : int
            Number of rays, one after another, whose first choices are spread evenly.
        seed : int

        Returns
        -------
        EyeEnds
            In an order that does not depend on threads.
        """
        count = dr.width(lane)
        choice = even_numbers(lane % samples, lane // samples, seed, 1).x
        p = dr.gather(mi.Point3f, p, dr.zeros(mi.UInt32, count)) if dr.width(p) == 1 else p
        ones, none = dr.full(mi.Float, 1, count), dr.zeros(mi.UInt32, count)
        on = _Rays(
            dr.arange(mi.UInt32, count), mi.UInt32(lane), none, choice, 0 * ones, ones,
            mi.Float(ones), mi.Point3f(p), mi.Vector3f(d), mi.UInt32(none), 0 * ones,
            mi.UInt32(none), 0 * ones, dr.full(mi.Int32, NO_OPENING, count),
            dr.full(mi.Bool, False, count),
        )  # fmt: skip
        dr.make_opaque(*on)  # the first surface needs no kernel of its own
        parts: dict[str, list[Ends]] = {"outside": [], "panes": [], "rough": [], "surfaces": []}
        for _ in range(MOST_SURFACES):
            onward = self._step(on, parts, seed)
            if onward is None:
                break
            on = onward
        return EyeEnds(**{name: joined(each or [Ends.none()]) for name, each in parts.items()})

    def reflected(self, ends: Ends, channel: int | None = None) -> mi.Float:
        """Share of the light that surfaces at ends reflect to the eye [–].

        The colour channel, −1 for luminance, is that of the scene unless another is given.
        """
        channel = self.scene.channel if channel is None else channel
        back = (ends.met & int(OnWay.BACK)) > 0
        cosine = dr.abs(dr.dot(ends.n, ends.d))
        return self.optics.diffuse(ends.part, back, cosine, channel, mi.Bool(True))

    def _step(self, on: _Rays, parts: dict[str, list[Ends]], seed: int) -> _Rays | None:
        """Trace rays to their next surfaces, note their ends, and return those that go on."""
        on, there = self._met(on, seed)
        si, hit = there.si, there.hit
        total = there.straight + there.turned + there.matt
        share = on.chance / dr.select(total > 0, total, 1)
        first = on.used + share * there.turned
        last = first + share * there.matt
        every = on.weight >= dr.opaque(mi.Float, self.all_ways)
        turns = (there.turned > 0) & (every | ((on.choice >= on.used) & (on.choice < first)))
        ends = (there.matt > 0) & (every | ((on.choice >= first) & (on.choice < last)))
        here = self._ends(on, there)
        of_end = on.weight * dr.select(every, 1, 1 / (share * there.matt))
        onward, lobe = self.sun.turned(on.turns, on.lobe, si, there.bs, turns)
        after = on._replace(
            place=(on.place + 2) * _APART, d=si.to_world(there.bs.wo), turns=onward, lobe=lobe,
            weight=on.weight * dr.select(every, there.turned, 1 / share),
            met=on.met | _of_turn(there), inside=self._inside(on, there),
        )  # fmt: skip
        beyond = on._replace(
            place=(on.place + 1) * _APART, weight=on.weight * there.straight,
            met=on.met | int(OnWay.PANE), used=dr.select(every, on.used, last),
            chance=dr.select(every, on.chance, share * there.straight),
        )  # fmt: skip
        lit = (on.met & int(OnWay.SCATTERING_PANE)) == 0
        kept = [
            lit & ~hit, lit & there.has(SurfaceKind.SCATTERS),
            lit & there.has(SurfaceKind.ROUGH_MIRROR), hit & ends, hit & turns,
            hit & (beyond.weight > LEAST_WEIGHT),
        ]  # fmt: skip
        dr.eval(*here, *after, *beyond, of_end, kept)
        *noted, turned_on, passed_on = map(dr.compress, kept)
        for (name, found), index in zip(parts.items(), noted, strict=True):
            if dr.width(index):
                found.append(_of_kind(name, taken(here, index), dr.gather(mi.Float, of_end, index)))
        going = []
        if dr.width(turned_on):
            going.append(_with_fresh_choice(_off_surface(after, here, turned_on), seed))
        if dr.width(passed_on):
            going.append(_off_surface(beyond, here, passed_on))
        if not going:
            return None
        rays = joined(going)
        dr.eval(*rays)
        return rays

    def _met(self, on: _Rays, seed: int) -> tuple[_Rays, MetSurface]:
        """Rays with what they note on their way to the next surface, and the surface."""
        ray = mi.Ray3f(on.o, on.d)
        self.scene.ray_counter.take("path", dr.width(on.ray))
        si = self.scene.met_faces.intersect(self.scene.full, ray, mi.Bool(True))
        hit = si.is_valid()
        if self.openings is not None:
            far = dr.select(hit, si.t, dr.inf)
            opening, again = self.openings.noted(ray, far, on.opening, on.again, mi.Bool(True))
            on = on._replace(opening=opening, again=again)
        if self._solids is not None:
            left = dr.select(hit, share_left(on.inside, si.p - on.o), 1)
            on = on._replace(weight=on.weight * left)
        bits = (random_bits(on.number, seed + pair, on.place + 1) for pair in range(2))
        x, y, z, _ = (mi.Float(each >> 8) * TO_UNIT for pair in bits for each in pair)
        return on, self.optics.met(si, on.d, x, mi.Point2f(y, z))

    def _ends(self, on: _Rays, there: MetSurface) -> Ends:
        """Ends of rays at surfaces, or outside, whether they end there or not."""
        n = dr.select(there.back, -there.si.n, there.si.n)
        return Ends(
            on.ray, on.weight, dr.select(there.hit, there.si.p, on.o), on.d,
            dr.select(there.hit, n, 0), dr.select(there.hit, there.part, OUTSIDE),
            self.sun.share(on.turns, on.lobe),
            on.met | dr.select(there.back, mi.UInt32(int(OnWay.BACK)), 0), on.opening, on.again,
        )  # fmt: skip

    @cached_property
    def _solids(self) -> mi.Float | None:
        return absorption(self.scene)

    def _inside(self, on: _Rays, there: MetSurface) -> mi.Float:
        """Absorption of the solid that rays are in after a turn [1/m]."""
        if self._solids is None:
            return on.inside
        return absorption_after(self._solids, there.si.bsdf(), there.bs, on.inside, there.hit)


def _off_surface(rays: _Rays, here: Ends, some: mi.UInt32) -> _Rays:
    """Some of the rays, which go on from a surface, off it along themselves.

    Off it along the normal, as `spawn_ray` has it, they would go on half a millimetre aside: curved
    lamellae of 3 mm facets would show a quarter more of a sun.
    """
    rays, p = taken(rays, some), dr.gather(mi.Point3f, mi.Point3f(here.p), some)
    far = OFFSET * (1 + dr.max(dr.abs(p)))
    return rays._replace(o=mi.Point3f(p + far * rays.d))


def _of_kind(name: str, ends: Ends, weight: mi.Float) -> Ends:
    """Ends of a kind: surfaces of another weight, panes and mirrors with their own normal."""
    if name == "surfaces":
        return ends._replace(weight=weight)
    if name == "outside":
        return ends
    behind = (ends.met & int(OnWay.BACK)) > 0
    return ends._replace(n=dr.select(behind, -ends.n, ends.n))


def _with_fresh_choice(rays: _Rays, seed: int) -> _Rays:
    """Rays after a turn, from which they go straight on as from the eye."""
    count, bits = dr.width(rays.ray), random_bits(rays.number, seed + 2, rays.place)[0]
    used, chance = dr.zeros(mi.Float, count), dr.full(mi.Float, 1, count)
    return rays._replace(choice=mi.Float(bits >> 8) * TO_UNIT, used=used, chance=chance)


def _of_turn(there: MetSurface) -> mi.UInt32:
    """Bits of `OnWay` of rays that surfaces turn."""
    bits = dr.select(there.bs.wo.z * there.si.wi.z < 0, mi.UInt32(int(OnWay.PANE)), 0)
    for kind, bit in (
        (SurfaceKind.GLAZING, OnWay.MIRRORING_PANE), (SurfaceKind.ROUGH, OnWay.ROUGH),
        (SurfaceKind.SCATTERS, OnWay.SCATTERING_PANE),
    ):  # fmt: skip
        bits |= dr.select(there.has(kind), mi.UInt32(int(bit)), 0)
    return bits | int(OnWay.TURN)
