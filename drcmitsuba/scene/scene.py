"""The surfaces of a case as the Mitsuba scenes that transport traces."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.materials import BsdfMaterial, DiffuserMaterial
from drcmitsuba.runtime.ray_counter import RayCounter
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.geometry import Port, Surface
from drcmitsuba.scene.materials import SurfaceMaterial, bsdf, film, lets_through
from drcmitsuba.scene.surfaces import Enclosure, State, geometry_of


@dataclass(frozen=True)
class Part:
    """Surfaces of one component and BSDF, which photons distinguish.

    Parameters
    ----------
    name : str
    bsdf : mi.BSDF
    material : SurfaceMaterial
    component : str
    quads : np.ndarray, shape (quad, 4, 3)
    closed : bool
        Whether they enclose a body.
    """

    name: str
    bsdf: Any
    material: SurfaceMaterial
    component: str
    quads: np.ndarray
    closed: bool


@dataclass(frozen=True)
class ScatteringPanes:
    """Quadrilaterals (pane, 4, 3) of one diffusing material; the front faces the room."""

    quads: np.ndarray
    transmittance: float
    reflectance: float


@dataclass(frozen=True)
class FilmPanes:
    """Quadrilaterals (pane, 4, 3) of one measured material; the front faces the room."""

    quads: np.ndarray
    bsdf: Any
    """The plugin `tensor_tree` or `klems`."""


@dataclass(frozen=True)
class Scene:
    """Scenes and panes of a case, as transport traces them.

    Parameters
    ----------
    full : mi.Scene
        All surfaces.
    opaque : mi.Scene
        All surfaces but the panes that let light straight through: any hit is a shadow.
    clear : mi.Scene or None
        Only those panes; None without any.
    scattering : tuple of ScatteringPanes
        Diffusing panes, for the deposit D by points on them.
    films : tuple of FilmPanes
        Panes with a measured BSDF.
    corners : np.ndarray, shape (corner, 3)
        Corners of all surfaces [m].
    enclosure : Enclosure or None
        The room, where there is one.
    parts : tuple of Part
        All surfaces, by BSDF.
    ports : tuple of Port
        Rectangles at which photons start.
    effects : EnabledEffects
        Effects that are simulated.
    ray_counter : RayCounter
        Number of rays traced.
    """

    full: mi.Scene
    opaque: mi.Scene
    clear: mi.Scene | None
    scattering: tuple[ScatteringPanes, ...]
    films: tuple[FilmPanes, ...]
    corners: np.ndarray
    enclosure: Enclosure | None = None
    parts: tuple[Part, ...] = ()
    ports: tuple[Port, ...] = ()
    effects: EnabledEffects = ALL_EFFECTS
    ray_counter: RayCounter = field(default_factory=RayCounter)

    @property
    def followed(self) -> bool:
        """Whether photons are traced."""
        return bool(self.ports) or self.effects.pane_to_pane

    @property
    def low(self) -> np.ndarray:
        """Lower bound of all surfaces [m]."""
        return self.corners.min(axis=0)

    @property
    def high(self) -> np.ndarray:
        """Upper bound of all surfaces [m]."""
        return self.corners.max(axis=0)


def mesh(name: str, vertices: np.ndarray, faces: np.ndarray, bsdf: mi.BSDF | None) -> mi.Mesh:
    """Triangle mesh of vertices (vertex, 3) and faces (face, 3)."""
    props = mi.Properties()
    if bsdf is not None:
        props["bsdf"] = bsdf
    made = mi.Mesh(name, vertex_count=len(vertices), face_count=len(faces), props=props)
    params = mi.traverse(made)
    params["vertex_positions"] = mi.Float(vertices.astype(np.float32).ravel())
    params["faces"] = mi.UInt32(faces.astype(np.uint32).ravel())
    params.update()
    return made


def quad_mesh(name: str, quads: np.ndarray, bsdf: mi.BSDF | None = None) -> mi.Mesh:
    """One mesh of quadrilaterals (quad, 4, 3); quad i has triangles 2i and 2i + 1."""
    corner = np.arange(len(quads))[:, None] * 4
    faces = np.concatenate([corner + [0, 1, 2], corner + [0, 2, 3]], axis=1)
    return mesh(name, quads.reshape(-1, 3), faces.reshape(-1, 3), bsdf)


def build(
    surfaces: list[Surface], channel: int = 0, enclosure: Enclosure | None = None,
    ports: tuple[Port, ...] = (),
) -> Scene:  # fmt: skip
    """Make the Mitsuba scenes of a list of surfaces.

    Parameters
    ----------
    surfaces : list of Surface
    channel : int
        Colour channel that is simulated.
    enclosure : Enclosure, optional
        The room, where there is one; shadow rays that cannot leave it are spared.
    ports : tuple of Port
        Rectangles at which photons start.

    Returns
    -------
    Scene
    """
    made = _outlined(surfaces, channel, enclosure, ports)
    meshes = [quad_mesh(part.name, part.quads, part.bsdf) for part in made.parts]

    def scene(keep: Any) -> mi.Scene:
        shapes = {
            f"shape{i}": mesh
            for i, (part, mesh) in enumerate(zip(made.parts, meshes, strict=True))
            if keep(part)
        }
        return mi.load_dict({"type": "scene", **shapes}, optimize=False)

    def is_clear(part: Part) -> bool:
        return lets_through(part.material)

    full, panes = scene(lambda part: True), any(map(is_clear, made.parts))
    return replace(
        made,
        full=full,
        opaque=scene(lambda part: not is_clear(part)) if panes else full,
        clear=scene(is_clear) if panes else None,
    )


def _outlined(
    surfaces: list[Surface], channel: int, enclosure: Enclosure | None, ports: tuple[Port, ...]
) -> Scene:
    """Scene with its parts and panes, before the Mitsuba scenes are made."""
    groups: dict[tuple[str, SurfaceMaterial, bool], list[Surface]] = {}
    for surface in surfaces:
        key = (surface.component, surface.material, surface.closed)
        groups.setdefault(key, []).append(surface)
    # One mesh for each material and component: many shapes slow tracing.
    parts = []
    for (component, m, closed), group in groups.items():
        quads = np.concatenate([s.quads for s in group])
        loaded = mi.load_dict(bsdf(m, channel))
        parts.append(Part(group[0].name, loaded, m, component, quads, closed))
    scattering = tuple(
        ScatteringPanes(p.quads, p.material.transmittance, p.material.reflectance)
        for p in parts
        if isinstance(p.material, DiffuserMaterial) and not p.component
    )
    films = tuple(
        FilmPanes(p.quads, p.bsdf)
        for p in parts
        if isinstance(p.material, BsdfMaterial) and not p.component
    )
    points = np.concatenate([s.quads.reshape(-1, 3) for s in surfaces] or [np.zeros((1, 3))])
    return Scene(
        full=None,
        opaque=None,
        clear=None,
        scattering=scattering,
        films=films,
        corners=points,
        enclosure=enclosure,
        parts=tuple(parts),
        ports=ports,
    )


def load(
    case: Case, state: State = "open", channel: int = 0, effects: EnabledEffects = ALL_EFFECTS
) -> Scene:
    """Build the scene of a case.

    Parameters
    ----------
    case : Case
    state : {'open', 'shaded'}
        State of the shade; a closed one replaces clear panes and open holes.
    channel : int
        Colour channel, 0 to 2; −1 for luminance.
    effects : EnabledEffects
        Effects that are simulated.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        A component, a film or a piece of furniture is unfit.
    """
    parts = geometry_of(case, state, effects)
    return replace(build(parts[0], channel, *parts[1:]), effects=effects)


def is_coloured(case: Case) -> bool:
    """Whether any reflectance differs between colour channels, or a film is coloured."""
    values = [f.reflectance for f in case.furniture]
    if case.room is not None:
        values += [case.room.floor, case.room.ceiling, case.room.walls]
    values += [f.frame_reflectance for f in case.facade.values()]
    films = [m for m in case.materials.values() if isinstance(m, BsdfMaterial)]
    return any(isinstance(v, tuple) and len(set(v)) > 1 for v in values) or any(
        film(m.file).coloured for m in films
    )
