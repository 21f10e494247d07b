"""Ways of light to the eye: from a pixel by mirrors and panes to the first diffuse surface.

A ray ends at the first surface that reflects diffusely. On its way mirrors send it on, and panes
let it pass or mirror it. Three kinds of light reach the eye on it:

* sky and sun, straight through clear panes, which is no random choice, and by mirrors, of which
  some show the sun in other ways: see `mirrored_sun`;
* the light of the first pane that scatters, which glows;
* what the diffuse surface reflects.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.sampling import streams
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.rendering.mirrored_sun import MirroredSun
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.gather.paths import deviates
from drcmitsuba.transport.mirrors.planar_mirrors import NONE
from drcmitsuba.transport.rays.bsdf_lookup import absorption, absorption_after, share_left
from drcmitsuba.transport.rays.shadow_rays import straight

MOST_SURFACES = 64
"""Largest number of mirrors and panes on a way to the eye."""


@dataclass(frozen=True)
class EyePaths:
    """Ways of rays to the eye, an entry for each ray; weights are radiance per radiance."""

    d: mi.Vector3f
    """Direction from the eye."""
    through: mi.Float
    """Weight of the sky's and the sun's light along `d`."""
    mirrored_d: mi.Vector3f
    mirrored: mi.Float
    """Direction in which the ray leaves the scene after mirrors, and the weight of the light."""
    mirrored_sun: mi.Float
    """Share of the sun's light along `mirrored_d` that counts [–]."""
    rough_part: mi.UInt32
    rough_p: mi.Point3f
    rough_n: mi.Normal3f
    rough_d: mi.Vector3f
    rough: mi.Float
    """One of the rough mirrors on the way, drawn by their weights: part of the scene, place off the
    surface, normal, direction of the ray before it, and the sum of the weights."""
    pane_o: mi.Point3f
    pane_d: mi.Vector3f
    pane: mi.Float
    """Last part of the ray before the first pane that scatters, and the weight of its glow."""
    p: mi.Point3f
    n: mi.Normal3f
    weight: mi.Float
    """First diffuse surface, off the surface, its normal towards the ray, and the weight of the
    radiance E/π; the surface's reflectance is part of the weight."""
    within: mi.Bool
    """Whether the way from the eye to that surface has passed no pane."""


@symbolic
def follow(
    scene: Scene, eye: mi.Point3f, d: mi.Vector3f, exists: mi.Bool, lane: mi.UInt32, samples: int,
    seed: int, sun: MirroredSun,
) -> EyePaths:  # fmt: skip
    """Follow rays from the eye.

    Parameters
    ----------
    scene : Scene
    eye : mi.Point3f
        Place of the eye [m].
    d : mi.Vector3f
        Unit vectors of the rays.
    exists : mi.Bool
        Rays that count.
    lane : mi.UInt32
        Numbers of the rays, from which their random numbers follow.
    samples : int
        Number of rays of a pixel: their first choices are spread evenly.
    seed : int
    sun : MirroredSun
        Mirrors of the scene, and how they show the sun.

    Returns
    -------
    EyePaths
    """
    through = straight(scene, mi.Point3f(eye), d, exists)
    random, ctx = streams(lane, seed), mi.BSDFContext()
    first_choice = even_numbers(lane % samples, lane // samples, seed, 1).x
    ray, beta, active = mi.Ray3f(mi.Point3f(eye), d), mi.Float(1), mi.Bool(exists)
    mirrored_d, mirrored = mi.Vector3f(d), mi.Float(0)
    pane_o, pane_d, pane = mi.Point3f(ray.o), mi.Vector3f(d), mi.Float(0)
    p, n, weight = mi.Point3f(ray.o), mi.Normal3f(d), mi.Float(0)
    shines, deviated, glows = mi.Bool(True), mi.Bool(False), mi.Bool(True)
    within, depth = mi.Bool(True), mi.UInt32(0)
    way, lobe, mirrored_sun = mi.UInt32(0), mi.Float(0), mi.Float(0)
    rough_part, rough = mi.UInt32(NONE), mi.Float(0)
    rough_p, rough_n, rough_d = mi.Point3f(ray.o), mi.Normal3f(d), mi.Vector3f(d)
    solids = absorption(scene)
    inside, before = mi.Float(0), mi.Point3f(ray.o)
    flags = mi.RayFlags.Minimal | mi.RayFlags.ShadingFrame
    while dr.hint(active, exclude=[scene, solids, first_choice, sun]):
        scene.ray_counter.add("path", active)
        si = scene.full.ray_intersect(ray, flags, coherent=False, active=active)
        leaves = active & ~si.is_valid() & shines & deviated
        mirrored = dr.select(leaves, beta, mirrored)
        mirrored_d = dr.select(leaves, ray.d, mirrored_d)
        mirrored_sun = dr.select(leaves, sun.share(way, lobe), mirrored_sun)
        active &= si.is_valid()
        si.wi = si.to_local(-ray.d)
        if dr.hint(solids is not None, mode="scalar"):
            beta *= share_left(inside, si.p - before)
        bsdf = si.bsdf()
        kinds = bsdf.flags()
        is_pane = deviates(kinds)
        scatters = mi.has_flag(kinds, mi.BSDFFlags.DiffuseTransmission)
        scatters |= mi.has_flag(kinds, mi.BSDFFlags.GlossyTransmission)
        glowing = active & scatters & glows
        pane = dr.select(glowing, beta, pane)
        pane_o, pane_d = dr.select(glowing, ray.o, pane_o), dr.select(glowing, ray.d, pane_d)
        facing = dr.select(dr.dot(si.n, ray.d) < 0, si.n, -si.n)
        if dr.hint(sun.rough is not None, mode="scalar"):
            part = sun.glossy(bsdf, active & shines)
            meets = part != NONE
            rough += dr.select(meets, beta, 0)
            drawn = meets & (random.next_float32() * rough < beta)
            rough_part = dr.select(drawn, part, rough_part)
            rough_p = dr.select(drawn, si.spawn_ray(facing).o, rough_p)
            rough_n = dr.select(drawn, si.sh_frame.n, rough_n)
            rough_d = dr.select(drawn, ray.d, rough_d)
        choice = dr.select(depth == 0, first_choice, random.next_float32())
        uv = mi.Point2f(random.next_float32(), random.next_float32())
        bs, value = bsdf.sample(ctx, si, choice, uv, active)
        beta *= value[0]
        active &= beta > 0
        diffuse = mi.has_flag(bs.sampled_type, mi.BSDFFlags.DiffuseReflection) & ~is_pane
        ends = active & diffuse
        p, n = dr.select(ends, si.spawn_ray(facing).o, p), dr.select(ends, facing, n)
        weight = dr.select(ends, beta, weight)
        if dr.hint(solids is not None, mode="scalar"):
            inside, before = absorption_after(solids, bsdf, bs, inside, active), si.p
        passes = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        deviated |= active & ~passes
        way, lobe = sun.turned(way, lobe, si, bs, active & ~passes)
        glows &= ~(scatters & ~passes)  # light between scattering panes has other estimators
        shines &= ~(scatters & ~passes)
        within &= bs.wo.z * si.wi.z > 0
        ray = dr.select(ends, ray, si.spawn_ray(si.to_world(bs.wo)))
        depth += 1
        active &= ~ends & (depth < MOST_SURFACES)
    return EyePaths(
        d, through, mirrored_d, mirrored, mirrored_sun, rough_part, rough_p, rough_n, rough_d,
        rough, pane_o, pane_d, pane, p, n, weight, within,
    )  # fmt: skip
