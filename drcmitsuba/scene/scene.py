"""The surfaces of a case as the Mitsuba scenes that transport traces."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, State
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    PorousMaterial,
    SurfaceMaterial,
)
from drcmitsuba.runtime.ray_counter import RayCounter
from drcmitsuba.scene.box_faces import BoxFaces
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.flat_panes import FlatPanes
from drcmitsuba.scene.geometry import Port, Surface, heading, turn
from drcmitsuba.scene.geometry import clockwise as turned_by
from drcmitsuba.scene.materials import ends_paths, film, lets_through, loaded
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.met_faces import MetFaces
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.surfaces import Enclosure, bounds_of_rooms, geometry_of
from drcmitsuba.schema import LUMINANCE_WEIGHTS

Tint = Callable[[Surface], SurfaceMaterial]
"""Function that gives the material that a surface takes, in a band of the spectrum for instance."""


def untinted(surface: Surface) -> SurfaceMaterial:
    """Material that a surface has."""
    return surface.material


@dataclass(frozen=True)
class ScenePart(Surface):
    """Surfaces of one component and BSDF, which photons distinguish."""

    bsdf: Any = None


@dataclass(frozen=True)
class Scene:
    """Scenes and panes of a case, as transport traces them."""

    full: mi.Scene
    """All surfaces."""
    opaque: mi.Scene
    """All surfaces but those that let light straight through: any hit is a shadow."""
    clear: mi.Scene | None
    """Only those: clear panes and porous surfaces; None without any."""
    corners: np.ndarray
    """Corners of all surfaces [m], shape (corner, 3)."""
    enclosure: Enclosure | None = None
    """The room, where there is one."""
    near: np.ndarray | None = None
    """Bounds of the rooms of a model along most walls [m], shape (2, 3): cells grow beyond them."""
    heading: float = 0.0
    """Angle of most walls [deg], see `geometry.heading`: cells lie along them."""
    parts: tuple[ScenePart, ...] = ()
    """All surfaces, by BSDF."""
    channel: int = -1
    """Colour channel, 0 to 2; −1 for luminance."""
    ports: tuple[Port, ...] = ()
    """Rectangles at which photons start."""
    effects: EnabledEffects = ALL_EFFECTS
    """Effects that are simulated."""
    occluders: mi.Scene | None = None
    """Opaque surfaces that rays meet which leave a box by its openings: all but its faces beside
    the openings; None for rooms that are no boxes."""
    faces: BoxFaces | None = None
    """Faces of a box room, where each is of one material but for an aperture."""
    apart: mi.Scene | None = None
    """All surfaces but those faces beside their apertures, where there are such."""
    flat_panes: FlatPanes | None = None
    """The same as `clear`, where all of it are a few flat panes of clear glass."""
    panes: mi.Scene | None = None
    """Clear panes alone, where porous surfaces stand beside them."""
    clockwise: float = 0.0
    """Angle of the room in the world [deg], by which horizontal films are turned."""
    ray_counter: RayCounter = field(default_factory=RayCounter)
    """Number of rays traced."""
    _met_faces: MetFaces | None = field(default=None, repr=False, compare=False)
    """See `met_faces`; a copy with the same surfaces has the same."""

    def __post_init__(self) -> None:
        """Collect the faces, which cannot be done within a loop that is being recorded."""
        every = [each for each in (self.full, self.clear, self.apart) if each is not None]
        if self._met_faces is None or not self._met_faces.are_of(every):
            object.__setattr__(self, "_met_faces", MetFaces.of(*every))

    @property
    def met_faces(self) -> MetFaces:
        """Faces of `full`, `clear` and `apart`, which are looked up where rays meet them."""
        assert self._met_faces is not None
        return self._met_faces

    @property
    def scattering(self) -> tuple[ScenePart, ...]:
        """Diffusing panes of the room, for the deposit D by points on them."""
        return self._panes(DiffuserMaterial)

    @property
    def films(self) -> tuple[ScenePart, ...]:
        """Panes of the room with a measured BSDF, the plugin `tensor_tree` or `klems`."""
        return self._panes(BsdfMaterial)

    def _panes(self, kind: type) -> tuple[ScenePart, ...]:
        return tuple(p for p in self.parts if isinstance(p.material, kind) and not p.component)

    @property
    def followed(self) -> bool:
        """Whether photons are traced."""
        return bool(self.ports) or self.effects.pane_to_pane

    @property
    def content(self) -> tuple[Any, ...]:
        """Everything that light in this scene depends on, for the key of stored coefficients."""
        parts = [(p.material, p.quads, p.component, p.closed, p.indoors) for p in self.parts]
        effects = self.effects.to_dict()
        turned = self.clockwise if self.films else 0.0
        around = self.near, self.heading
        return parts, self.channel, self.enclosure, around, self.ports, effects, turned

    @property
    def from_within(self) -> tuple[Any, ...]:
        """Everything that paths among its surfaces depend on: panes without reflection are alike.

        Light that may come back from beyond the panes depends on all of it.
        """
        parts, channel, room, *others = self.content
        if not self.effects.beyond:
            parts = [(None if ends_paths(part[0]) else part[0], *part[1:]) for part in parts]
        if room is not None and room.is_box:
            room = room.size, room.turn  # its openings matter to light from outside
        return parts, channel, room, *others

    def searched(self, **changes: Any) -> Scene:
        """Scene with changes of its surfaces, in which nothing is met in closed form."""
        changes |= {"occluders": None, "faces": None, "apart": None, "flat_panes": None}
        return replace(self, **changes)

    def along_walls(self, points: np.ndarray) -> np.ndarray:
        """Points (…, 3) [m] in the frame along most walls."""
        return points @ turn(self.heading) if self.heading else points

    @property
    def bounds(self) -> np.ndarray:
        """Bounds of all surfaces along most walls [m], shape (2, 3)."""
        corners = self.along_walls(self.corners)
        return np.stack([corners.min(axis=0), corners.max(axis=0)])


def build(
    surfaces: list[Surface], channel: int = 0, enclosure: Enclosure | None = None,
    ports: tuple[Port, ...] = (), clockwise: float = 0.0,
) -> Scene:  # fmt: skip
    """Make the Mitsuba scenes of a list of surfaces in one colour channel.

    Shadow rays that cannot leave the enclosure are spared; photons start at the ports; horizontal
    films are turned `clockwise` with the room [deg].
    """
    groups: dict[tuple[str, SurfaceMaterial, bool, bool], list[Surface]] = {}
    for surface in surfaces:
        key = (surface.component, surface.material, surface.closed, surface.indoors)
        groups.setdefault(key, []).append(surface)
    # One mesh for each material and component: many shapes slow tracing.
    parts: list[ScenePart] = []
    shapes = {}
    for (component, m, closed, indoors), group in groups.items():
        quads = np.concatenate([s.quads for s in group])
        bsdf = loaded(m, channel, clockwise)
        part = ScenePart(group[0].name, m, quads, component, closed, indoors=indoors, bsdf=bsdf)
        shapes[f"shape{len(parts)}"] = quad_mesh(part.name, quads, part.bsdf)
        parts.append(part)
    is_clear = [lets_through(part.material) for part in parts]
    is_pane = [
        clear and not isinstance(part.material, PorousMaterial)
        for part, clear in zip(parts, is_clear, strict=True)
    ]

    def scene(keep: list[bool]) -> mi.Scene:
        kept = {name: mesh for (name, mesh), k in zip(shapes.items(), keep, strict=True) if k}
        return mitsuba_scene(kept)

    let_through = [part for part, clear in zip(parts, is_clear, strict=True) if clear]
    is_glass = all(isinstance(part.material, GlazingMaterial) for part in let_through)
    full = scene([True] * len(parts))
    return Scene(
        full=full,
        opaque=scene([not clear for clear in is_clear]) if any(is_clear) else full,
        clear=scene(is_clear) if any(is_clear) else None,
        **(_of_box(enclosure, parts) if enclosure is not None and enclosure.is_box else {}),
        flat_panes=FlatPanes.of((p.quads, p.bsdf) for p in let_through) if is_glass else None,
        panes=scene(is_pane) if any(is_pane) and is_pane != is_clear else None,
        corners=np.concatenate([s.quads.reshape(-1, 3) for s in surfaces] or [np.zeros((1, 3))]),
        clockwise=clockwise,
        enclosure=enclosure,
        parts=tuple(parts),
        ports=ports,
    )


def _of_box(room: Enclosure, parts: Sequence[ScenePart]) -> dict[str, Any]:
    """Fields of a scene that only box rooms have: `occluders`, `faces`, `apart`."""
    opaque = (room.may_hide(p.quads) & (not lets_through(p.material)) for p in parts)
    only: dict[str, Any] = {"occluders": _of_quads(parts, opaque)}
    faces = BoxFaces.of(room, parts)
    if faces is not None:
        beside = replace(room, openings=faces.apertures)
        apart = _of_quads(parts, (beside.may_hide(p.quads) for p in parts))
        only |= {"faces": faces, "apart": apart}
    return only


def _of_quads(parts: Sequence[ScenePart], masks: Iterable[np.ndarray]) -> mi.Scene:
    """Scene of some quads of the parts, a mask (quad,) of each."""
    some = [(p, p.quads[mask]) for p, mask in zip(parts, masks, strict=True) if mask.any()]
    meshes = {f"shape{i}": quad_mesh(p.name, q, p.bsdf) for i, (p, q) in enumerate(some)}
    return mitsuba_scene(meshes)


def load(
    case: Case, state: State = OPEN, channel: int = 0, effects: EnabledEffects = ALL_EFFECTS,
    groups: PaneGroups | None = None, tint: Tint = untinted,
) -> Scene:  # fmt: skip
    """Build the scene of a case.

    Parameters
    ----------
    state : str
        State of the façade, see `case.groups`; a closed shade replaces clear panes and holes.
    channel : int
        Colour channel, 0 to 2; −1 for luminance.
    effects : EnabledEffects
        Effects that are simulated.
    groups : PaneGroups, optional
        Groups whose state it is; by default those of the case.
    tint : callable
        Gives the materials of the surfaces.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        A component, a film or a piece of furniture is unfit.
    """
    surfaces, enclosure, ports = geometry_of(case, state, effects, groups)
    surfaces = [replace(each, material=tint(each)) for each in surfaces]
    built = build(surfaces, channel, enclosure, ports, turned_by(case))
    return replace(
        built, effects=effects, near=bounds_of_rooms(case), heading=heading(case), channel=channel
    )


def channels_of(case: Case, effects: EnabledEffects) -> tuple[int, ...]:
    """Colour channels to simulate, as `load` takes them: luminance alone (−1) for a grey case."""
    coloured = is_coloured(case) if effects.channels is None else effects.channels
    return tuple(range(len(LUMINANCE_WEIGHTS))) if coloured else (-1,)


def is_coloured(case: Case) -> bool:
    """Whether any reflectance differs between colour channels, or a film is coloured."""
    values = [f.reflectance for f in case.furniture]
    layers = [part for layer in case.building.layers for part in (layer, *layer.added)]
    of_model = (material for layer in layers for material in layer.materials)
    for m in of_model:
        if isinstance(m, Lambertian):
            values += m.sides
        elif isinstance(m, PorousMaterial):
            values.append(m.reflectance)
    if case.room is not None:
        values += [case.room.floor, case.room.ceiling, case.room.walls]
    values += [f.frame_reflectance for f in case.facade.values()]
    films = [m for m in case.materials.values() if isinstance(m, BsdfMaterial)]
    return any(isinstance(v, tuple) and len(set(v)) > 1 for v in values) or any(
        film(m.file).coloured for m in films
    )
