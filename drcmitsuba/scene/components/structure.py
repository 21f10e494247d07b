"""Micro-structure in the strips of a façade that name it.

Layers from the façade plane outward, each a `gap` from the next: the mouth towards the room, the
inner pane, a ledge (for clear structures only), the structure, the outer pane, the outer mouth. The
casing closes the four sides from mouth to mouth, and the rest of the pane beside whole periods.

A clear structure stands off its casing by the gap; a ledge, twice as wide, covers that slit and
stops straight light.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.components import StructureComponent
from drcmitsuba.model.materials import GlazingMaterial, Lambertian, SurfaceMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components.placed_component import PlacedComponent, ray_offset
from drcmitsuba.scene.geometry import Port, Surface, quad
from drcmitsuba.scene.structures.block import MM, Block, block, is_clear
from drcmitsuba.scene.structures.recipe import Lamellae, Mesh, Recipe, load_recipe
from drcmitsuba.scene.structures.structure import MOST_TRIANGLES

FINEST = 20
"""Least length of a period [ray offset]; finer structures need a BSDF.

The error of the light through films/prism.toml is 1.3 % here, 6 % at 10 and 0.3 % at 40.
"""


@dataclass(frozen=True)
class Opening:
    """Pane of the façade in its own axes: s along, h up, t out of the room [m]."""

    origin: np.ndarray
    along: np.ndarray
    up: np.ndarray
    out: np.ndarray
    """Lower left corner as seen from outside [m], and unit vectors, shape (3,) each."""
    width: float
    height: float
    """Extents along s and h [m]."""

    @classmethod
    def of(cls, pane: np.ndarray) -> Opening:
        """Opening of a pane (4, 3) from `geometry.wall`."""
        up, along = pane[1] - pane[0], pane[3] - pane[0]
        height, width = float(np.linalg.norm(up)), float(np.linalg.norm(along))
        up, along = up / height, along / width
        return cls(pane[0], along, up, np.cross(along, up), width, height)

    def at(self, s: float, h: float, t: float) -> np.ndarray:
        """Point (3,) at coordinates s, h, t [m]."""
        return self.origin + s * self.along + h * self.up + t * self.out

    def rectangle(self, s: tuple[float, float], h: tuple[float, float], t: float) -> np.ndarray:
        """Rectangle (4, 3) across the opening, front towards the room."""
        return quad(self.at(s[0], h[0], t), self.up * (h[1] - h[0]), self.along * (s[1] - s[0]))

    def border(
        self, outer: tuple[float, float, float, float], inner: tuple[float, float, float, float],
        t: float,
    ) -> list[np.ndarray]:  # fmt: skip
        """Rectangles between an outer and an inner one, each lowest and highest s, then h [m]."""
        (a, b, c, d), (e, f, g, h) = outer, inner
        pieces = [((a, b), (c, g)), ((a, b), (h, d)), ((a, e), (g, h)), ((f, b), (g, h))]
        return [self.rectangle(s, v, t) for s, v in pieces if s[1] > s[0] and v[1] > v[0]]


def recipe_of(case: Case, name: str, component: StructureComponent) -> Recipe:
    """Recipe of a component, with its own tilt.

    Raises
    ------
    InputError
        The recipe is unfit, a tilt is given without lamellae, or glass beside the recipe's own.
    """
    recipe = load_recipe(component.recipe)
    if component.tilt is not None:
        if not isinstance(recipe.structure, Lamellae):
            got = f"the recipe is of kind {recipe.structure.kind}"
            where = f"components.{name}.tilt"
            raise InputError(case.source, where, got, "only lamellae are tilted: leave it out")
        tilted = recipe.structure.model_copy(update={"tilt": component.tilt})
        recipe = recipe.model_copy(update={"structure": tilted})
    if recipe.glass is not None and component.outer is not None:
        got = "the recipe has its own [glass]"
        raise InputError(case.source, f"components.{name}.outer", got, "keep one of them")
    return recipe


def structure(
    case: Case, name: str, component: StructureComponent, panes: list[np.ndarray]
) -> PlacedComponent:
    """Build a structure into panes (4, 3) of the façades, fronts inward, in the room's frame [m].

    Raises
    ------
    InputError
        As `recipe_of`; no period fits into a pane; layers or periods are too fine for rays.
    """
    recipe = recipe_of(case, name, component)
    offset = ray_offset(np.array(panes)) if panes else 0.0
    _check_fineness(case, name, component, recipe, offset)
    outer: SurfaceMaterial | None = None
    if component.outer is not None:
        outer = case.materials[component.outer]
    elif recipe.glass is not None:
        g = recipe.glass
        outer = GlazingMaterial(
            type="glazing", transmittance=g.transmittance, exponent=g.exponent,
            reflectance=g.reflectance,
        )  # fmt: skip
    inner = case.materials[component.inner] if component.inner is not None else None
    quads_by_name: dict[str, list[np.ndarray]] = defaultdict(list)
    ports, blocks, count = [], {}, 0
    for pane in panes:
        opening = Opening.of(pane)
        size = round(opening.width, 9), round(opening.height, 9)
        if size not in blocks:
            slit = component.gap if is_clear(recipe) else 0.0
            blocks[size] = block(recipe, size[0] - 2 * slit, size[1] - 2 * slit)
        count += 2 * len(blocks[size].quads)
        if count > MOST_TRIANGLES:
            got = f"more than {MOST_TRIANGLES} triangles in all panes"
            field = f"components.{name}.recipe"
            raise InputError(case.source, field, got, "give longer periods")
        ports += _fill(quads_by_name, opening, blocks[size], component, recipe, outer is not None)
    casing = Lambertian(component.casing)
    made: dict[str, SurfaceMaterial | None] = {"casing": casing, "outer": outer, "inner": inner}
    for built in blocks.values():
        made["structure"] = built.material
    surfaces = [
        Surface(f"{name} {key}", material, np.concatenate(quads_by_name[key]), name)
        for key, material in made.items()
        if material is not None and quads_by_name[key]
    ]
    return PlacedComponent(name, tuple(surfaces), tuple(Port(name, q) for q in ports))


def _check_fineness(
    case: Case, name: str, component: StructureComponent, recipe: Recipe, offset: float
) -> None:
    """Refuse layers and periods that rays would skip."""
    s = recipe.structure
    period = min(s.period) if isinstance(s, Mesh) else s.period
    if period * MM < FINEST * offset:
        got = f"a period of {period:g} mm is too fine to be traced in this room"
        remedy = f"give {FINEST * offset / MM:.2g} mm or more, or take its BSDF (goniophotometer)"
        raise InputError(case.source, f"components.{name}.recipe", got, remedy)
    gaps = {"gap": component.gap}
    if recipe.glass is not None:
        gaps["recipe, glass.distance"] = recipe.glass.distance * MM
    for key, gap in gaps.items():
        if gap < 2 * offset:
            got = f"rays would skip {gap / MM:.3g} mm of air"
            remedy = f"give at least {2 * offset / MM:.2g} mm"
            raise InputError(case.source, f"components.{name}.{key}", got, remedy)


def _layers(
    component: StructureComponent, recipe: Recipe, thickness: float, has_outer: bool
) -> dict[str, float]:
    """Distances of the layers that there are from the façade plane, outward [m].

    The layer "structure" is the structure's face towards the room.
    """
    gap, at = component.gap, {}
    t = gap
    if component.inner is not None:
        at["inner"], t = t, t + gap
    if is_clear(recipe):
        at["ledge"], t = t, t + gap
    at["structure"], t = t, t + thickness
    if has_outer:
        t += gap if recipe.glass is None else recipe.glass.distance * MM
        at["outer"] = t
    return at | {"mouth": t + gap}


def _fill(
    quads_by_name: dict[str, list[np.ndarray]], opening: Opening, built: Block,
    component: StructureComponent, recipe: Recipe, has_outer: bool,
) -> list[np.ndarray]:  # fmt: skip
    """Add one pane's surfaces to those of its component; return its two ports (4, 3)."""
    at = _layers(component, recipe, built.size[2], has_outer)
    slit = component.gap if "ledge" in at else 0.0
    # A block as wide or high as its pane leaves no blank, whatever the rounding.
    clear = [n + 2 * slit for n in built.size[:2]]
    spare = [max(0.0, n - c) for n, c in zip((opening.width, opening.height), clear, strict=True)]
    spare = [0.0 if n < 1e-9 else n / 2 for n in spare]
    s = (spare[0], opening.width - spare[0])
    h = (spare[1], opening.height - spare[1])
    mouth = (*s, *h)
    middle = opening.at(sum(s) / 2, sum(h) / 2, at["structure"])
    axes = np.stack([-opening.along, opening.up, -opening.out])
    quads_by_name["structure"].append(built.quads @ axes + middle)
    casing = opening.border((0, opening.width, 0, opening.height), mouth, 0.0)
    if "ledge" in at:
        w = 2 * slit
        within = (s[0] + w, s[1] - w, h[0] + w, h[1] - w)
        casing += opening.border(mouth, within, at["ledge"])
    across, upright = opening.along * (s[1] - s[0]), opening.up * (h[1] - h[0])
    depth = opening.out * at["mouth"]
    a, b = opening.at(s[0], h[0], 0), opening.at(s[1], h[1], 0)
    casing += [quad(a, depth, across), quad(a, upright, depth)]
    casing += [quad(b, -across, depth), quad(b, depth, -upright)]
    quads_by_name["casing"].append(np.array(casing))
    for key in {"outer", "inner"} & at.keys():
        quads_by_name[key].append(opening.rectangle(s, h, at[key])[None])
    return [opening.rectangle(s, h, at["mouth"]), opening.rectangle(s, h, 0.0)[[0, 3, 2, 1]]]
