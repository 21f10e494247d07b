"""Planar mirrors of a scene: the surfaces in which suns have images, and the turns they take.

Clear panes that mirror and smooth mirrors in few planes have exact images of the suns: see
`image_suns`. Curved mirrors and bodies of many faces are left to photons, and so is what more
mirrors in turn send than a chain has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from math import prod
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.grazing import more_at_grazing

from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    MirrorMaterial,
    SurfaceMaterial,
)
from drcmitsuba.model.model import MOST_OF_BODY, areas, count_planes
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import Surface, is_triangle, normals
from drcmitsuba.scene.materials import is_mirroring_glass
from drcmitsuba.scene.scene import Scene, ScenePart
from drcmitsuba.transport.mirrors.mirror_planes import (
    COPLANAR,
    MOST_IN_TURN,
    MirrorFaces,
    chains_of,
    face_each_other,
    leads,
    planes_followed,
    sides_seen,
    strongest_of,
)
from drcmitsuba.transport.rays.bsdf_lookup import number, numbers, table

MOST_LOBES = 8
"""Largest number of different lobes of rough mirrors."""
REMAINS = 0.02
"""The same for mirrors beyond `MOST_IN_TURN`, which photons follow."""
FAINT_TURN = 0.1
"""The same for a rough mirror and another one, which nothing but photons follows [–].

A rough façade of 0.8 opposite the glass of an office leaves out 0.1 % of the light at the eye.
"""
STEPS = 513
"""Number of cosines of the incidence at which reflectances are tabulated."""
NONE = 0xFFFFFFFF


def is_planar_mirror(part: Surface) -> bool:
    """Whether a part mirrors without scattering; a body does in few planes that are no duct.

    The walls of a room that mirror little are no duct: what they send on in turn is faint.
    """
    m = part.material
    if is_mirroring_glass(m):
        return not part.component
    return isinstance(m, MirrorMaterial) and m.roughness == 0 and _is_in_few_planes(part)


def is_rough_mirror(part: Surface) -> bool:
    """Whether a part mirrors into a lobe, in few planes that are no duct."""
    m = part.material
    return isinstance(m, MirrorMaterial) and m.roughness > 0 and _is_in_few_planes(part)


def lobe_of(material: SurfaceMaterial) -> MirrorMaterial:
    """Mirror of the lobe of a rough one, but of reflectance 1 and without a diffuse part."""
    assert isinstance(material, MirrorMaterial)
    return material.model_copy(update={"reflectance": 1.0, "specular": 1.0})


def _is_in_few_planes(mirror: Surface) -> bool:
    material = mirror.material
    if (isinstance(material, MirrorMaterial) and material.specular == 0) or albedo(material) == 0:
        return False
    quads = mirror.quads[areas(mirror.quads) > 0]
    if count_planes(quads) > MOST_OF_BODY:
        return False
    return albedo(material) ** 2 <= REMAINS or not _is_duct(quads)


def albedo(material: SurfaceMaterial) -> float:
    """Reflectance of a mirror or a pane at normal incidence, without its diffuse part [–]."""
    return float(_reflectances(material)[:, -1].max())


def has_images(part: Surface, effects: EnabledEffects) -> bool:
    """Whether the effects of a scene let the light of a planar mirror count."""
    if part.component:
        return effects.components
    pane = part.material
    return effects.pane_to_pane or (isinstance(pane, GlazingMaterial) and pane.ior is not None)


def turns_beyond_mirrors(scene: Scene) -> bool:
    """Whether a surface deviates light that has no images: a film, a solid, a curved mirror."""
    kinds = BsdfMaterial | DielectricMaterial | MirrorMaterial
    return any(
        (isinstance(part.material, kinds) and not (is_planar_mirror(part) or is_rough_mirror(part)))
        or (bool(part.component) and is_mirroring_glass(part.material))
        or (isinstance(part.material, DiffuserMaterial) and bool(part.component))
        for part in scene.parts
    )


def imaged_components(scene: Scene) -> frozenset[str]:
    """Names of the components all of whose light has images, so that photons need not follow it.

    Of what a rough mirror and another one send on in turn, at most `FAINT_TURN` may be left out.
    """
    rough = tuple(PlanarMirrors.rough(scene).values())
    smooth = PlanarMirrors.of(scene)
    every = rough if smooth is None else (smooth, *rough)
    if any(m.remains or m.left_out for m in every) or turns_beyond_mirrors(scene):
        return frozenset()
    if any(_send_on(one, other) for one in rough for other in every):
        return frozenset()
    imaged = {i for mirrors in every for i in mirrors.parts}
    others = {part.component for i, part in enumerate(scene.parts) if i not in imaged}
    return frozenset(scene.parts[i].component for i in imaged) - others - {""}


def _send_on(one: PlanarMirrors, other: PlanarMirrors) -> bool:
    """Whether mirrors that face each other send on more than `FAINT_TURN` in turn."""
    rho = [max(albedo(m.scene.parts[i].material) for i in m.parts) for m in (one, other)]
    pairs = product(one.rectangles, other.rectangles)
    return prod(rho) > FAINT_TURN and any(face_each_other(a, b) for a, b in pairs)


@dataclass(frozen=True)
class PlanarMirrors:
    """Planar mirrors of a scene."""

    scene: Scene
    parts: tuple[int, ...]
    """Indices of the parts of the scene that are planar mirrors."""
    axes: np.ndarray
    """Unit normals, of either sign, shape (axis, 3)."""
    rectangles: tuple[np.ndarray, ...]
    """Rectangles around the mirrors of every plane, twice, with their front to either side, by axis
    [m], shape (rectangle, 4, 3)."""
    seen: tuple[np.ndarray, ...]
    """The same, without the sides of panes that face a room which no other pane lights."""
    strongest: np.ndarray
    """Largest reflectance of an axis at normal incidence [–], shape (axis,)."""
    chains: tuple[tuple[int, ...], ...]
    """Axes of the mirrors of every chain, from the receiver to the sun."""
    left_out: int
    """Number of planes that are left out, since there are more than the program follows."""
    remains: bool
    """Whether mirrors of bodies may send on more light in turn than chains do."""
    first: mi.UInt32
    """First face of a part in `axis_of`, by the number of its BSDF; `NONE` of what is no mirror."""
    axis_of: mi.UInt32
    """Axis of every face; `NONE` where its plane is left out."""
    reflectance: mi.Float
    """Reflectance of parts by side (front, back) and cosine, flat (part, side, step)."""
    row: mi.UInt32
    """Part of `reflectance`, by the number of its BSDF."""

    @property
    def has_bodies(self) -> bool:
        """Whether any mirror is no pane."""
        return any(self.scene.parts[i].component for i in self.parts)

    @property
    def most_in_turn(self) -> int:
        """Largest number of mirrors of a chain."""
        return max(map(len, self.chains))

    @classmethod
    def of(cls, scene: Scene) -> PlanarMirrors | None:
        """Collect the planar mirrors of a scene; None without any."""
        return cls._among(scene, is_planar_mirror)

    @classmethod
    def rough(cls, scene: Scene) -> dict[MirrorMaterial, PlanarMirrors]:
        """Collect the rough mirrors in few planes of a scene, by a mirror with their lobe.

        Photons follow those whose lobes are beyond the `MOST_LOBES` of the largest area.
        """
        every: dict[MirrorMaterial, PlanarMirrors] = {}
        area: dict[MirrorMaterial, float] = {}
        for part in filter(is_rough_mirror, scene.parts):
            lobe = lobe_of(part.material)
            area[lobe] = area.get(lobe, 0.0) + float(areas(part.quads).sum())
        for lobe in sorted(area, key=lambda lobe: -area[lobe])[:MOST_LOBES]:

            def has_lobe(part: ScenePart, lobe: MirrorMaterial = lobe) -> bool:
                return is_rough_mirror(part) and lobe_of(part.material) == lobe

            mirrors = cls._among(scene, has_lobe)
            every |= {} if mirrors is None else {lobe: mirrors}
        return every

    @classmethod
    def of_panes(cls, scene: Scene, quads: np.ndarray) -> PlanarMirrors | None:
        """Collect those panes of clear glass that are `quads` (quad, 4, 3); None without any.

        They mirror at their fronts, into the room.
        """
        scene = replace(scene, effects=replace(scene.effects, pane_to_pane=True))
        centres = quads.mean(axis=1)

        def mine(part: ScenePart) -> np.ndarray:
            apart = part.quads.mean(axis=1)[:, None] - centres
            return np.asarray((np.abs(apart).max(axis=2) < COPLANAR).any(axis=1))

        def is_mirror(part: ScenePart) -> bool:
            is_pane = isinstance(part.material, GlazingMaterial) and is_planar_mirror(part)
            return is_pane and bool(mine(part).any())

        every = cls._among(scene, is_mirror)
        if every is None:
            return None
        parts = [scene.parts[i] for i in every.parts]
        kept = np.concatenate(
            [np.repeat(mine(part), np.where(is_triangle(part.quads), 1, 2)) for part in parts]
        )
        axis_of = np.where(kept, every.axis_of.numpy(), NONE)
        fronts = every.reflectance.numpy().reshape(len(parts), 2, STEPS) * np.array([[1], [0]])
        return replace(every, axis_of=flat_indices(axis_of), reflectance=flat(fronts))

    @classmethod
    def _among(cls, scene: Scene, is_mirror: Callable[[Any], bool]) -> PlanarMirrors | None:
        mirrors = [
            (i, part)
            for i, part in enumerate(scene.parts)
            if is_mirror(part) and has_images(part, scene.effects)
        ]
        if not mirrors:
            return None
        rho = [albedo(part.material) for _, part in mirrors]
        sorted_faces = MirrorFaces.of([part.quads for _, part in mirrors], rho)
        if sorted_faces is None:
            return None
        quads, owner, axis, plane, kept, axes, rectangles, strongest = sorted_faces
        left_out = planes_followed(quads)[1]
        reflectances = np.stack([_reflectances(part.material) for _, part in mirrors])
        of_body = np.array([bool(part.component) for _, part in mirrors])[owner]
        body = np.array([of_body[axis == a].any() for a in range(len(axes))])
        inside = np.full(len(quads), scene.effects.pane_to_pane) | of_body
        seen = [
            np.concatenate([sides_seen(quads[plane == p], inside[plane == p]) for p in kept
                            if axis[plane == p][0] == a])
            for a in range(len(axes))
        ]  # fmt: skip
        faces = np.where(is_triangle(quads), 1, 2)
        starts = np.r_[0, np.cumsum(faces)]
        begins = [int(starts[np.argmax(owner == k)]) for k in range(len(mirrors))]
        first, row = np.full(len(scene.parts), NONE), np.zeros(len(scene.parts), int)
        first[[i for i, _ in mirrors]], row[[i for i, _ in mirrors]] = begins, range(len(mirrors))
        of_faces = np.repeat(np.where(axis < 0, NONE, axis), faces)
        by_number = table(scene, first.tolist(), np.uint32)
        by_number[~np.isin(np.arange(len(by_number)), numbers(scene))] = NONE
        return cls(
            scene, tuple(i for i, _ in mirrors), axes, tuple(rectangles), tuple(seen), strongest,
            strongest_of(chains_of(rectangles, strongest)), left_out,
            _remains(rectangles, axes, strongest, body), flat_indices(by_number),
            flat_indices(of_faces), flat(reflectances),
            flat_indices(table(scene, row.tolist(), np.uint32)),
        )  # fmt: skip

    def met(
        self, si: mi.SurfaceInteraction3f, cosine: mi.Float, active: mi.Bool
    ) -> tuple[mi.UInt32, mi.Float]:
        """Axis of the mirror that rays meet, `NONE` for none, and its reflectance [–].

        `cosine` is that of the incidence, positive at the front.
        """
        which = number(si.bsdf())
        first = dr.gather(mi.UInt32, self.first, which, active)
        mirrors = active & (first != NONE)
        axis = dr.gather(mi.UInt32, self.axis_of, first + si.prim_index, mirrors)
        side = dr.gather(mi.UInt32, self.row, which, mirrors) * 2
        side += dr.select(cosine < 0, mi.UInt32(1), 0)
        x = dr.clip(dr.abs(cosine), 0, 1) * (STEPS - 1)
        step = dr.minimum(mi.UInt32(x), STEPS - 2)
        at = side * STEPS + step
        low, high = (dr.gather(mi.Float, self.reflectance, at + k, mirrors) for k in (0, 1))
        mirrors &= axis != NONE
        rho = dr.lerp(low, high, x - mi.Float(step))
        return dr.select(mirrors, axis, NONE), dr.select(mirrors, rho, 0)

    def images(self, chain: tuple[int, ...], suns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Images of suns (sun, 3) by a chain, and whether light may take it, shape (sun,).

        With R the reflection at an axis, a sun s is seen along R₁ R₂ … s.
        """
        d, may = suns.astype(float), np.ones(len(suns), bool)
        for place in range(len(chain) - 1, -1, -1):
            n = self.axes[chain[place]]
            d = d - 2 * (d @ n)[:, None] * n
            if place:
                may &= leads(self.rectangles[chain[place - 1]], self.rectangles[chain[place]], d)
        return d, may


def _reflectances(material: SurfaceMaterial) -> np.ndarray:
    """Mirrored share of light at the front and the back of a surface, by cosine, (side, step)."""
    c = np.linspace(0, 1, STEPS)
    if isinstance(material, MirrorMaterial) and material.polished:
        rho = material.mirrored + (1 - material.mirrored) * more_at_grazing(c)
        return np.stack([rho] * 2)
    if isinstance(material, MirrorMaterial):
        rho = np.full(STEPS, float(material.reflectance))
        if material.coating is not None:
            rho = _coated(material.reflectance, material.coating, c)
        return np.stack([material.specular * rho] * 2)
    assert isinstance(material, GlazingMaterial)
    if material.ior is not None:
        return np.stack([material.tables(STEPS)[1]] * 2)
    r = material.reflectance
    return np.stack([r + (1 - r) * (1 - c) ** 5 if r > 0 else 0 * c, 0 * c])


def _coated(rho: float, ior: float, c: np.ndarray) -> np.ndarray:
    """Reflectance of a mirror below a clear layer, as of the plugin `coated_mirror`, by cosine."""
    inside = np.sqrt(1 - (1 - c**2) / ior**2)
    faces = (c - ior * inside) / (c + ior * inside), (inside - ior * c) / (inside + ior * c)
    r = (faces[0] ** 2 + faces[1] ** 2) / 2
    return np.asarray(r + (1 - r) ** 2 * rho / np.maximum(1 - r * rho, 1e-6))


def _is_duct(quads: np.ndarray) -> bool:
    """Whether fronts of quads in several planes face each other: light may turn there often."""
    n = normals(quads)
    key = np.round(np.column_stack([n, np.einsum("qi,qi->q", n, quads[:, 0])]), 3)
    sides = [quads[(key == side).all(axis=1)] for side in np.unique(key, axis=0)]

    def sees(one: np.ndarray, two: np.ndarray) -> bool:
        return bool(((two.reshape(-1, 3) - one[0, 0]) @ normals(one[:1])[0]).max() > COPLANAR)

    return any(sees(a, b) and sees(b, a) for a in sides for b in sides)


def _remains(
    rectangles: list[np.ndarray], axes: np.ndarray, rho: np.ndarray, body: np.ndarray
) -> bool:
    """Whether a body and a mirror that face each other send on light beyond `MOST_IN_TURN`."""
    every, turns = range(len(axes)), MOST_IN_TURN + 1
    return any(
        body[a]
        and rho[a] ** ((turns + 1) // 2) * rho[b] ** (turns // 2) > REMAINS
        and face_each_other(rectangles[a], rectangles[b])
        for a in every
        for b in every
    )
