"""Hits of gather paths on each kind of surface, and path weights at other reflectances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.scene import scene
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.scene import Scene
from drcmitsuba.scene.surfaces import surfaces_of

WALLS = tuple(f"wall {side}" for side in ("south", "east", "north", "west"))
FRAMES = tuple(name.replace("wall", "frame") for name in WALLS)


class Hits:
    """Marks of paths that count how often a path met each kind of surface: `gather.Marks`.

    Every kind has the same number of bits of the mark. A full count stays full (31 hits with six
    kinds, 15 with eight); later hits on this kind keep their traced weight.

    Parameters
    ----------
    shapes : sequence of mi.Shape or None
        Mesh of each kind; None where a kind has no surface.
    """

    def __init__(self, shapes: Sequence[mi.Shape | None]) -> None:
        self.context = mi.BSDFContext()
        self.shapes = [None if shape is None else mi.ShapePtr(shape) for shape in shapes]
        self.bits = min(16, 32 // len(shapes))

    def meet(
        self, si: mi.SurfaceInteraction3f, mark: mi.UInt32, number: mi.Float
    ) -> tuple[mi.BSDFPtr, mi.UInt32, mi.Float, mi.Bool, mi.Bool]:
        """Count a hit on the surface; see `gather.Marks.meet`."""
        most = (1 << self.bits) - 1
        counted = mi.UInt32(mark)
        for k, shape in enumerate(self.shapes):
            if shape is None:
                continue
            shift = k * self.bits
            more = (si.shape == shape) & (((mark >> shift) & most) < most)
            counted = dr.select(more, mark + (1 << shift), counted)
        return si.bsdf(), counted, mi.Float(1), mi.Bool(True), mi.Bool(False)

    def digits(self, marks: mi.UInt32) -> list[list[mi.Bool]]:
        """Binary digits of every kind's count in `marks`, the lowest digit first."""
        digits = []
        for k in range(len(self.shapes)):
            n = (marks >> (k * self.bits)) & ((1 << self.bits) - 1)
            most = int(dr.max(n)[0]) if dr.width(n) else 0
            digits.append([((n >> j) & 1) == 1 for j in range(most.bit_length())])
        dr.eval(digits)
        return digits


def numbered(marks: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
    """Distinct marks, sorted, shape (distinct,), and the index of every mark among them."""
    if dr.width(marks) == 0:
        return marks, marks
    order = dr.argsort(marks)
    ranked = dr.gather(mi.UInt32, marks, order)
    at = dr.arange(mi.UInt32, dr.width(marks))
    new = (at == 0) | (ranked != dr.gather(mi.UInt32, ranked, dr.maximum(at, 1) - 1))
    rank = dr.cumsum(dr.select(new, mi.UInt32(1), 0)) - 1
    number = dr.zeros(mi.UInt32, dr.width(marks))
    dr.scatter(number, rank, order)
    kinds = dr.gather(mi.UInt32, ranked, dr.compress(new))
    dr.eval(number, kinds)
    return kinds, number


def powers(ratios: list[mi.Float], digits: list[list[mi.Bool]]) -> mi.Float:
    """Π ratioⁿ for every mark, by squaring: value and gradient are exact and finite at 0."""
    product = mi.Float(1)
    for ratio, of_count in zip(ratios, digits, strict=True):
        power = mi.Float(ratio)
        for digit in of_count:
            product *= dr.select(digit, power, 1)
            power = power * power
    return product


def marked(case: Case, state: State, values: Mapping[str, float]) -> tuple[Scene, Hits]:
    """Scene with one mesh for every kind of surface, and the counter of hits on them.

    `values` are the reflectances by kind: `floor`, `ceiling`, `walls`, or the names of furniture.
    """
    quads: dict[str, list[np.ndarray]] = {key: [] for key in values}
    others = []
    for surface in surfaces_of(case, state):
        key = "walls" if surface.name in WALLS else surface.name
        if key in quads and isinstance(surface.material, Lambertian):
            quads[key].append(surface.quads)
        else:
            others.append(surface)
    meshes = [
        scene.quad_mesh(key, np.concatenate(of_kind), mi.load_dict(bsdf(Lambertian(values[key]))))
        if of_kind
        else None  # walls entirely of glass
        for key, of_kind in quads.items()
    ]
    shapes = [*scene.build(others).full.shapes(), *(mesh for mesh in meshes if mesh is not None)]
    named = {f"shape{i}": shape for i, shape in enumerate(shapes)}
    full = mi.load_dict({"type": "scene", **named}, optimize=False)
    return replace(scene.load(case, state), full=full), Hits(meshes)


@dataclass(frozen=True)
class Sums:
    """Path weights (entry,) at the traced reflectances, each with the number of its mark.

    Each `value` is added to its `place`, 0 … size − 1.
    """

    place: mi.UInt32
    mark: mi.UInt32
    value: mi.Float
    size: int

    @classmethod
    def of(cls, place: mi.UInt32, mark: mi.UInt32, value: mi.Float, size: int) -> Sums:
        """Entries sorted by place, so that sums are faster."""
        order = dr.argsort(place)
        place, mark = (dr.gather(mi.UInt32, x, order) for x in (place, mark))
        value = dr.gather(mi.Float, value, order)
        dr.eval(place, mark, value)
        return cls(place, mark, value, size)

    def weighed(self, factor: mi.Float) -> mi.Float:
        """Sum of the entries of every place, each times the factor of its mark; shape (size,)."""
        out = dr.zeros(mi.Float64, self.size)
        # The factor's gradient is a sum of this kind, too.
        value = self.value * dr.gather(mi.Float64, mi.Float64(factor), self.mark)
        dr.scatter_add(out, value, self.place)
        return mi.Float(out)
