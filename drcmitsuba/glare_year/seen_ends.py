"""Ends of the rays of an eye as glare counts them: the outside, what glows, and surfaces.

A diffusing pane counts as two surfaces, whose illuminances it reflects and scatters through.

Limits: surfaces are left out that panes mirror, or that light films and diffusers from where eyes
see them: sky and suns alone are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.eye.ends import EndRows, Ends, OnWay
from drcmitsuba.eye.openings import SeenOpenings
from drcmitsuba.eye.paths import EyePaths
from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.mirrors.mirror_planes import FAINT

ALL_WAYS = 1e-3
"""Weight from which rays go all ways that a surface offers [–]."""


@dataclass(frozen=True)
class SeenEnds:
    """Ends of rays by their kind."""

    outside: EndRows
    """Sky, ground and sun."""
    glowing: EndRows
    """Films and rough mirrors."""
    surfaces: EndRows
    """Surfaces, with a weight for every channel."""


def eye_paths(scene: Scene, diameter: float, openings: SeenOpenings | None = None) -> EyePaths:
    """Paths of eyes for glare in a scene, under suns of an angle across [deg]."""
    return EyePaths.of(scene, diameter, openings, ALL_WAYS)


def seen_ends(
    paths: EyePaths, points: np.ndarray, directions: np.ndarray, *, seed: int, samples: int = 1,
    channels: Sequence[int] = (-1,),
) -> SeenEnds:  # fmt: skip
    """Follow rays to what glare counts.

    Parameters
    ----------
    paths : EyePaths
    points : np.ndarray, shape (3,) or (ray, 3)
        Place of the eye, or of every ray [m].
    directions : np.ndarray, shape (ray, 3)
        Unit vectors.
    seed : int
    samples : int
        Number of rays, one after another, whose first choices are spread evenly.
    channels : sequence of int
        Colour channels of reflectances, as of `scene.channels_of`.
    """
    lane = dr.arange(mi.UInt32, len(directions))
    p, d = (mi.Point3f(*(flat(np.atleast_2d(points)[:, k]) for k in range(3))),
            mi.Vector3f(*(flat(directions[:, k]) for k in range(3))))  # fmt: skip
    ends = paths.ends(p, d, lane, samples, seed)
    panes = ends.panes.rows()
    materials = [part.material for part in paths.scene.parts]
    by_material = (
        np.flatnonzero([isinstance(m, kind) for m in materials])
        for kind in (BsdfMaterial, DiffuserMaterial)
    )
    films, diffusers = (panes.take(np.isin(panes.part, some)) for some in by_material)
    glowing = EndRows.joined([films, ends.rough.rows()])
    surfaces = EndRows.joined([
        _surfaces(paths, ends.surfaces, channels), *_sides(paths, diffusers, len(channels))
    ])  # fmt: skip
    return SeenEnds(
        ends.outside.rows(),
        glowing.take((glowing.weight > FAINT) | ~glowing.has_met(OnWay.MIRRORING_PANE)),
        surfaces.take(~surfaces.has_met(OnWay.MIRRORING_PANE | OnWay.SCATTERING_PANE)),
    )


def _surfaces(paths: EyePaths, ends: Ends, channels: Sequence[int]) -> EndRows:
    """Surfaces with what they reflect in every channel."""
    rows = ends.rows()
    if not len(rows.ray):
        return rows._replace(weight=np.zeros((0, len(channels))))
    each = [(ends.weight * paths.reflected(ends, channel)).numpy() for channel in channels]
    weight = np.stack(each, axis=1).astype(float)
    return rows._replace(weight=weight[np.argsort(ends.ray.numpy(), kind="stable")])


def _sides(paths: EyePaths, ends: EndRows, channels: int) -> tuple[EndRows, EndRows]:
    """Sides of diffusing panes: those before the eye, and those beyond."""
    materials = [paths.scene.parts[part].material for part in ends.part]
    before = ~ends.has_met(OnWay.BACK)
    towards = np.where(before[:, None], ends.normal, -ends.normal)
    sides = np.array([m.sides for m in materials]).reshape(-1, 2)
    back = np.where(before, sides[:, 0], sides[:, 1]) * ends.weight
    through = np.array([m.scattered for m in materials]) * ends.weight
    both = (
        ends._replace(normal=n, weight=np.repeat(w[:, None], channels, axis=1))
        for n, w in ((towards, back), (-towards, through))
    )
    lit, beyond = both
    return lit.take(back > 0), beyond
