"""A user's model, as every reader gives it: surfaces by material, sensors, views, place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
    SurfaceMaterial,
)
from drcmitsuba.model.space import Space, numbered, overlap_notes
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.runtime.errors import printable

MOST_OF_BODY = 6
"""Largest number of planes of a mirror in which suns have images."""
DULL = (
    "Smooth surfaces that mirror at most 5 % of the light are diffuse where no light by way of "
    "mirrors counts, as beside groups of panes or with a mesh of suns, which lowers the "
    "illuminance in a room of them by 1 %"
)
Role = Literal["surface", "pane", "context"]
"""Part that a layer plays: surface of the rooms, pane in their envelope, or body outside."""


def role_of(*materials: SurfaceMaterial | None) -> Role:
    """Role of a layer by its materials: a pane where one of them is that of a pane.

    Porous surfaces are context; so is any other layer that the case names as such.
    """
    panes = GlazingMaterial | DiffuserMaterial | BsdfMaterial
    if any(isinstance(material, PorousMaterial) for material in materials):
        return "context"
    return "pane" if any(isinstance(material, panes) for material in materials) else "surface"


def areas(quads: np.ndarray) -> np.ndarray:
    """Areas (quad,) [m²] of parallelograms and triangles (quad, 4, 3)."""
    n = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    return np.asarray(np.linalg.norm(n, axis=1) / 2)


def count_planes(quads: np.ndarray) -> int:
    """Count the planes in which quads (quad, 4, 3) with an area lie, within 1 mm."""
    n = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
    length = np.linalg.norm(n, axis=1)
    quads, n = quads[length > 0], n[length > 0] / length[length > 0, None]
    n = n * np.where(n @ [0.61, 0.77, 0.17] < 0, -1, 1)[:, None]
    offset = np.einsum("qi,qi->q", n, quads[:, 0])
    return len(np.unique(np.round(np.column_stack([n, offset]), 3), axis=0))


@dataclass(frozen=True, eq=False)
class LayerState:
    """State that a layer takes together with the other layers of its group."""

    name: str
    """Name of the state: that of its material in the source."""
    material: SurfaceMaterial | None
    """Material of the layer in this state; None where the state leaves an opening."""
    shades: tuple[Layer, ...] = ()
    """Surfaces that stand in this state only."""


@dataclass(frozen=True, eq=False)
class Layer:
    """Surfaces of one material name."""

    name: str
    """Name of the material, layer or modifier in the source."""
    material: SurfaceMaterial
    role: Role
    quads: np.ndarray
    """Parallelograms, and triangles that repeat their last corner, counter-clockwise from the
    front [m], shape (quad, 4, 3)."""
    polygon: np.ndarray
    """Index of the source's polygon that each quad is part of, int, shape (quad,)."""
    places: tuple[str, ...]
    """Where each polygon stands in the source, for messages ("office.rad, line 12: wall.3");
    meshes of many faces may have one place for all, which then is the only entry."""
    group: str = ""
    """Group of panes that change their state together; "" for none."""
    states: tuple[LayerState, ...] = ()
    """States of the group, as this layer takes them: state k of a group is the k-th of each of its
    layers. Material and surfaces of the first state are `material` and `states[0].shades`."""
    stands_in: str = ""
    """Group in whose first state alone the surfaces stand; "" where they always stand."""
    behind: str = ""
    """Name of the material on the back, where it has another one: a wall between two rooms."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the materials of its sides."""
        return (self.name, self.behind) if self.behind else (self.name,)

    @property
    def deviates(self) -> bool:
        """Whether the layer is a mirror or a clear solid, whose light is no cell's."""
        return self.deviating is not None

    @property
    def is_polished(self) -> bool:
        """Whether the layer is diffuse and mirrors faintly besides."""
        return isinstance(self.material, Lambertian) and self.deviates

    @cached_property
    def deviating(self) -> MirrorMaterial | DielectricMaterial | None:
        """Mirror or clear solid that the layer is; None for other surfaces.

        A polished surface is one where it is grey and alike on both sides, has few planes and
        belongs to no group; elsewhere all that it reflects is diffuse.
        """
        material = self.material
        if isinstance(material, MirrorMaterial | DielectricMaterial):
            return material
        if not isinstance(material, Lambertian) or not material.polish or self.group:
            return None
        total = material.reflectance
        if isinstance(total, tuple) or material.behind is not None or self.stands_in:
            return None
        if count_planes(self.quads[areas(self.quads) > 0]) > MOST_OF_BODY:
            return None
        share = min(1.0, material.polish / total)
        return MirrorMaterial(type="mirror", reflectance=total, specular=share, polished=True)

    @property
    def sides(self) -> tuple[SurfaceMaterial, SurfaceMaterial]:
        """Materials of front and back."""
        if isinstance(self.material, Lambertian):
            front, back = map(Lambertian, self.material.sides)
            return front, back
        return self.material, self.material

    @property
    def materials(self) -> tuple[SurfaceMaterial | None, ...]:
        """Materials that the layer may take: its own, then those of further states."""
        return self.material, *(state.material for state in self.states[1:])

    @property
    def added(self) -> tuple[Layer, ...]:
        """Surfaces that stand in further states."""
        return tuple(shade for state in self.states[1:] for shade in state.shades)

    @property
    def shape(self) -> tuple[Any, ...]:
        """Content of the layer, in which the kinds of its materials stand for these."""
        kinds = tuple(type(material).__name__ for material in self.materials)
        shades = tuple(shade.shape for state in self.states for shade in state.shades)
        surfaces = self.role, self.quads, self.polygon, self.places
        return *self.names, *surfaces, self.group, self.stands_in, kinds, shades

    def place(self, quad: int) -> str:
        """Where a quad stands in the source."""
        return self.places[min(int(self.polygon[quad]), len(self.places) - 1)]

    def made_of(self, material: SurfaceMaterial) -> Layer:
        """Put another material in place, and with it its role."""
        if material is self.material:
            return self
        return replace(self, material=material, role=role_of(material))


@dataclass(frozen=True, eq=False)
class SensorGrid:
    """Sensors of a model."""

    name: str
    points: np.ndarray
    """Positions [m], shape (sensor, 3)."""
    normals: np.ndarray
    """Unit normals, shape (sensor, 3)."""


@dataclass(frozen=True)
class View:
    """View of a model, in the terms of Radiance's `rview`."""

    name: str
    kind: str
    """v, h, a, s, c or l of `-vt`."""
    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    up: tuple[float, float, float]
    angles: tuple[float, float]
    """`-vh` and `-vv` [deg]; sizes [m] of a parallel view."""

    def scaled(self, factor: float) -> View:
        """Multiply all lengths."""
        x, y, z = self.position
        wide, high = self.angles
        angles = (wide * factor, high * factor) if self.kind == "l" else self.angles
        return replace(self, position=(x * factor, y * factor, z * factor), angles=angles)


def numbered_views(views: Iterable[View]) -> tuple[View, ...]:
    """Views whose names differ: further ones of a name are numbered, equal ones stand once."""
    named: dict[str, list[View]] = {}
    for view in views:
        alike = named.setdefault(view.name, [])
        if view not in alike:
            alike.append(view)
    return tuple(
        replace(view, name=f"{name} {k + 1}" if k else name)
        for name, alike in named.items()
        for k, view in enumerate(alike)
    )


@dataclass(frozen=True)
class Location:
    """Place on earth that a model states."""

    latitude: float
    """[deg north]."""
    longitude: float
    """[deg east]."""
    name: str = ""


@dataclass(frozen=True)
class ModelShape:
    """Shape of a model; models that are read anew for each row of a study have equal ones."""

    digest: str
    model: Model = field(compare=False, repr=False)
    """A model of this shape."""


@dataclass(frozen=True, eq=False)
class Model:
    """Everything that a source says, in metres, z up."""

    layers: tuple[Layer, ...] = ()
    grids: tuple[SensorGrid, ...] = ()
    views: tuple[View, ...] = ()
    location: Location | None = None
    north: float = 0.0
    """Direction of true north in the model, clockwise from its y axis [deg]."""
    notes: tuple[str, ...] = ()
    """One sentence for everything in the source that was simplified or left out."""
    spaces: tuple[Space, ...] = ()
    """Rooms that the source names; their names differ."""

    @cached_property
    def shape(self) -> ModelShape:
        """All that does not depend on the values of its materials."""
        layers = tuple(layer.shape for layer in self.layers)
        return ModelShape(content_key(layers, self.grids, self._shapes, self.north), self)

    @property
    def _shapes(self) -> tuple[Any, ...]:
        return tuple(space.shape for space in self.spaces)

    @cached_property
    def digest(self) -> str:
        """Digest of all that light depends on."""
        return content_key(self.layers, self.grids, self._shapes, self.north)

    @cached_property
    def polished(self) -> tuple[str, ...]:
        """Names of the surfaces that mirror faintly and are diffuse besides."""
        return tuple(dict.fromkeys(layer.name for layer in self.layers if layer.is_polished))

    def without_polish(self) -> Model:
        """Have faintly mirroring surfaces reflect diffusely what they mirror, with a note."""
        return self._matt

    @cached_property
    def _matt(self) -> Model:
        if not self.polished:
            return self
        note = f"{DULL}: {', '.join(self.polished)}."
        layers = tuple(
            layer.made_of(replace(layer.material, polish=0.0))
            if layer.is_polished and isinstance(layer.material, Lambertian) else layer
            for layer in self.layers
        )  # fmt: skip
        return replace(self, layers=layers, notes=(*self.notes, note))

    def scaled(self, factor: float) -> Model:
        """Multiply all lengths."""
        if factor == 1:
            return self
        layers = (replace(layer, quads=layer.quads * factor) for layer in self.layers)
        grids = (replace(grid, points=grid.points * factor) for grid in self.grids)
        views = tuple(view.scaled(factor) for view in self.views)
        spaces = tuple(space.scaled(factor) for space in self.spaces)
        return replace(self, layers=tuple(layers), grids=tuple(grids), views=views, spaces=spaces)


EMPTY = Model()
"""No model."""


def joined(models: Sequence[Model]) -> Model:
    """Join the contents of several sources; location and north are the first that are stated."""
    stated = [m for m in models if m.location is not None]
    spaces = numbered([space for m in models for space in m.spaces])
    return Model(
        tuple(layer for m in models for layer in m.layers),
        tuple(grid for m in models for grid in m.grids),
        numbered_views(view for m in models for view in m.views),
        stated[0].location if stated else None,
        next((m.north for m in models if m.north), 0.0),
        (*(note for m in models for note in m.notes), *overlap_notes(spaces)),
        spaces,
    )


def with_printable_names(model: Model) -> Model:
    """Write out the control characters in the names, places and notes of a model."""

    def named(layer: Layer) -> Layer:
        states = tuple(
            replace(state, name=printable(state.name), shades=tuple(map(named, state.shades)))
            for state in layer.states
        )
        return replace(
            layer, name=printable(layer.name), behind=printable(layer.behind),
            group=printable(layer.group), states=states, places=tuple(map(printable, layer.places)),
        )  # fmt: skip

    place = model.location
    return replace(
        model, location=place and replace(place, name=printable(place.name)),
        layers=tuple(map(named, model.layers)), notes=tuple(map(printable, model.notes)),
        grids=tuple(replace(grid, name=printable(grid.name)) for grid in model.grids),
        views=tuple(replace(view, name=printable(view.name)) for view in model.views),
        spaces=tuple(
            replace(s, name=printable(s.name), use=printable(s.use), storey=printable(s.storey))
            for s in model.spaces
        ),
    )  # fmt: skip
