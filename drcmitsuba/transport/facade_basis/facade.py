"""Façade of a basis: tiles, the materials that may fill them, and the marks of paths.

An *element* is one tile filled with one material. Light that comes in through the façade is a sum
over elements; light that the room sends back to the façade is weighed by the elements that it met,
up to `HITS` of them in a row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    Reflectance,
    SurfaceMaterial,
)
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.scene.materials import bsdf, lets_through, shade_covers
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.tiled_facades import FRAME

HITS = 3
"""Times that a path may meet the façade; light that meets it oftener, some 10⁻⁵ of E, is lost."""
BITS = 10
"""Bits of a path's mark for each element that it met."""
MOST_ELEMENTS = (1 << BITS) - 1


@dataclass(frozen=True)
class Tiles:
    """Rectangles of a façade, grouped into tiles; a tile has one composition."""

    rectangles: np.ndarray
    """Left, right, bottom and top from the foot of the wall [m], shape (rectangle, 4)."""
    tile: np.ndarray
    """Tile of each rectangle, int, shape (rectangle,)."""
    quads: np.ndarray
    """Corners of the rectangles in the world, fronts into the room [m], shape (rectangle, 4, 3)."""

    def __len__(self) -> int:
        """Count the tiles."""
        return int(self.tile.max()) + 1

    @cached_property
    def area(self) -> np.ndarray:
        """Area of every tile, shape (tile,) [m²]."""
        left, right, bottom, top = self.rectangles.T
        return np.bincount(self.tile, (right - left) * (top - bottom))

    @cached_property
    def bounds(self) -> np.ndarray:
        """Left, right, bottom and top of every tile, shape (tile, 4) [m]."""
        own = [self.rectangles[self.tile == t] for t in range(len(self))]
        low, high = (np.array([of(r, axis=0) for r in own]) for of in (np.min, np.max))
        return np.stack([low[:, 0], high[:, 1], low[:, 2], high[:, 3]], axis=1)

    def of(self, tile: int) -> np.ndarray:
        """Rectangles of a tile, shape (rectangle, 4, 3) [m]."""
        return self.quads[self.tile == tile]


@dataclass(frozen=True)
class Palette:
    """Materials that tiles may be filled with."""

    materials: Mapping[str, SurfaceMaterial | None]
    """Materials by name; `open`, a hole, is None."""
    shade: str | None
    """Name of the material that stands before clear tiles while the shade is closed."""
    allowed: np.ndarray
    """Materials that each tile may be filled with, bool, shape (tile, material)."""
    own_shade: bool = False
    """Whether the shade's material may fill a tile also while the shade is open."""

    @classmethod
    def of(
        cls, case: Case, names: tuple[str, ...], allowed: np.ndarray, frame: Reflectance = 0.0
    ) -> Palette:
        """Materials of a case by name; `wall` and `FRAME` are opaque, `open` is a hole.

        The shade is added where the case has one and a tile may be clear.

        Raises
        ------
        InputError
            A name is unknown, or there are too many elements.
        """
        materials = {name: _material(case, name, frame) for name in names}
        shade = case.shading.material if case.shading is not None else None
        clear = np.array([shade_covers(m) for m in materials.values()])
        own_shade = shade in materials
        if shade is not None and allowed[:, clear].any():
            behind = allowed[:, clear].any(axis=1)
            if shade not in materials:
                materials[shade] = case.materials[shade]
                allowed = np.column_stack([allowed, behind])
            else:
                allowed = allowed.copy()
                allowed[:, list(materials).index(shade)] |= behind
        else:
            shade = None
        if allowed.size > MOST_ELEMENTS:
            got = f"{allowed.shape[0]} tiles × {allowed.shape[1]} materials"
            remedy = f"take fewer tiles: at most {MOST_ELEMENTS} products"
            raise InputError(case.source, "facade", got, remedy)
        return cls(materials, shade, allowed, own_shade)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the materials, the columns of a composition."""
        return tuple(self.materials)

    @property
    def kinds(self) -> tuple[SurfaceMaterial | None, ...]:
        """Materials in the order of their names."""
        return tuple(self.materials.values())

    @cached_property
    def clear(self) -> np.ndarray:
        """Whether the shade covers a material, shape (material,)."""
        return np.array([shade_covers(m) for m in self.kinds])

    @cached_property
    def straight(self) -> np.ndarray:
        """Whether straight light passes a material, shape (material,)."""
        return np.array([m is None or lets_through(m) for m in self.kinds])

    @cached_property
    def scattering(self) -> np.ndarray:
        """Whether a material scatters light into the room, shape (material,)."""
        return np.array([isinstance(m, BsdfMaterial | DiffuserMaterial) for m in self.kinds])

    @cached_property
    def lets_in(self) -> np.ndarray:
        """Whether light comes in by a material, shape (material,)."""
        return np.array([not isinstance(m, Lambertian) for m in self.kinds])

    @cached_property
    def closing(self) -> np.ndarray:
        """Matrix (material, material) that turns compositions into those with the shade closed."""
        move = np.eye(len(self.names), dtype=np.float32)
        if self.shade is not None:
            move[self.clear] = 0
            move[self.clear, self.names.index(self.shade)] = 1
        return move


def _material(case: Case, name: str, frame: Reflectance) -> SurfaceMaterial | None:
    """Material of a tile by its name."""
    if name == "open":
        return None
    if name == "wall":
        assert case.room is not None
        return Lambertian(case.room.walls)
    if name == FRAME:
        return Lambertian(frame)
    if name not in case.materials:
        known = ", ".join(["wall", "open", *case.materials])
        raise InputError(case.source, "materials", f"no {name!r}", f"choose one of {known}")
    return case.materials[name]


def _mirrors(material: SurfaceMaterial | None) -> bool:
    """Whether a material sends light back into the room."""
    if isinstance(material, Lambertian):
        return any(np.max(rho) > 0 for rho in material.sides)
    if isinstance(material, GlazingMaterial | DiffuserMaterial):
        return material.reflectance > 0
    return isinstance(material, BsdfMaterial)


class Meetings:
    """Marks of paths that meet tiles whose material is left open: a `gather.paths.Marks`.

    At a tile one of its materials is drawn, and the element is stored in the path's mark, `BITS`
    for each of up to `HITS` meetings. The weight, which includes the inverse of the draw's
    probability, times Π share[element] holds for any composition.
    """

    def __init__(self, tiles: Tiles, palette: Palette) -> None:
        self.mesh = quad_mesh("façade", tiles.quads)
        self.context = mi.BSDFContext()
        reflected = mi.BSDFFlags.Reflection  # a path that leaves the room meets nothing
        self.context.type_mask = +reflected
        self._facade = mi.ShapePtr(self.mesh)
        mirrors = np.array([_mirrors(m) for m in palette.kinds])
        choices = palette.allowed & mirrors
        self._count = flat_indices(choices.sum(axis=1))
        # Possible choices come first.
        self._choice = flat_indices(np.argsort(~choices, axis=1, kind="stable"))
        self._tile = flat_indices(tiles.tile)
        self._materials = len(mirrors)
        seen = [m if m is not None and _mirrors(m) else Lambertian(0.0) for m in palette.kinds]
        self._bsdfs = [mi.load_dict(bsdf(m)) for m in seen]

    def meet(
        self, si: mi.SurfaceInteraction3f, mark: mi.UInt32, number: mi.Float
    ) -> tuple[mi.BSDFPtr, mi.UInt32, mi.Float, mi.Bool, mi.Bool]:
        """Draw the material of a tile; see `gather.paths.Marks.meet`."""
        mine = si.shape == self._facade
        tile = dr.gather(mi.UInt32, self._tile, si.prim_index // 2, mine)
        count = dr.gather(mi.UInt32, self._count, tile, mine)
        k = dr.minimum(mi.UInt32(number * mi.Float(count)), dr.maximum(count, 1) - 1)
        material = dr.gather(mi.UInt32, self._choice, tile * self._materials + k, mine)
        element = tile * self._materials + material + 1
        chosen = si.bsdf()
        for i, each in enumerate(self._bsdfs):
            chosen = dr.select(mine & (material == i), mi.BSDFPtr(each), chosen)
        once_more = mark < (1 << BITS * (HITS - 1))
        factor = dr.select(mine, dr.select(once_more, mi.Float(count), 0), 1)
        mark = dr.select(mine, (mark << BITS) | element, mark)
        return chosen, mark, factor, ~mine, mi.Bool(False)


def elements(mark: mi.UInt32) -> list[mi.UInt32]:
    """Elements that a path met, counted from 1; 0 for no meeting."""
    return [(mark >> (BITS * i)) & MOST_ELEMENTS for i in range(HITS)]
