"""Marks of gather paths that meet openings whose fill is left open: a `gather.paths.Marks`.

An *element* is an opening with one of its fills. At an opening one of its fills is drawn, and the
element is stored in the path's mark. The throughput, which includes the inverse of the draw's
probability, times the product of the shares of the elements of the mark holds for every façade.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial, SurfaceMaterial
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.meshes import paired_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.panes_in_state import GroupedPanes
from drcmitsuba.scene.scene import Scene

MEETINGS = 3
"""Times that a path may meet openings; light that meets more of them, some 10⁻⁵ of E, is lost."""
BITS = 10
"""Bits of a mark for each meeting."""
MOST_ELEMENTS = (1 << BITS) - 1
DEPOSITED = 1 << BITS * MEETINGS
"""Bit of the mark of a path that ends at a film: it gets the light that reaches the film straight,
and none that surfaces send there."""


class OpeningMarks:
    """Marks of paths at openings.

    Parameters
    ----------
    panes : sequence of GroupedPanes
    first : np.ndarray of int, shape (group + 1,)
        First element of every opening, counted from 0, and their number.
    channel : int
        Colour channel, −1 for luminance.
    deposits : bool
        Whether light is deposited on panes that scatter, as if they sent it on evenly; else their
        light is part of the deposit on all that they light.
    """

    def __init__(
        self, panes: Sequence[GroupedPanes], first: np.ndarray, channel: int, *,
        deposits: bool = True,
    ) -> None:  # fmt: skip
        self.quads = np.concatenate([each.quads for each in panes])
        self.mesh = paired_mesh("panes", self.quads)
        self.context = mi.BSDFContext()
        self._panes = mi.ShapePtr(self.mesh)
        piece = np.repeat(np.arange(len(panes)), [len(each.quads) for each in panes])
        group = np.array([each.group for each in panes])
        self._first = flat_indices(first[group][piece])
        self._count = flat_indices(np.diff(first)[group][piece])
        # One BSDF for each material; a hole lets everything pass.
        kinds: dict[SurfaceMaterial | None, int] = {}
        fills = int(np.diff(first).max())
        table = np.zeros((len(panes), fills), int)
        for i, each in enumerate(panes):
            for k, material in enumerate(each.materials):
                table[i, k] = kinds.setdefault(material, len(kinds))
        self._table, self._fills = flat_indices(table.ravel()), fills
        self._piece = flat_indices(piece)
        hole = {"type": "null"}
        self._bsdfs = [mi.load_dict(hole if m is None else bsdf(m, channel)) for m in kinds]
        scatters = [deposits and isinstance(m, DiffuserMaterial | BsdfMaterial) for m in kinds]
        self._scatters = mi.Bool(scatters)
        self._has_lobes = mi.Bool([deposits and isinstance(m, BsdfMaterial) for m in kinds])
        self._may_split = False

    def ending(self) -> OpeningMarks:
        """Marks of paths that end where light is deposited: at a film half of them do, `DEPOSITED`.

        The others go on by its lobes. Paths of all bounces do both.
        """
        other = copy(self)
        other._may_split = True
        return other

    def placed_in(self, empty: Scene) -> Scene:
        """Scene with these panes, whose fill is left open, in the empty places of a scene."""

        def with_panes(shapes: Sequence[mi.Shape]) -> mi.Scene:
            return mitsuba_scene({f"shape{i}": one for i, one in enumerate((*shapes, self.mesh))})

        corners = np.concatenate([empty.corners, self.quads.reshape(-1, 3)])
        world = empty.searched(full=with_panes(empty.full.shapes()), corners=corners)
        if empty.faces is None or empty.apart is None:
            return world
        return replace(world, faces=empty.faces, apart=with_panes(empty.apart.shapes()))

    def meet(
        self, si: mi.SurfaceInteraction3f, mark: mi.UInt32, number: mi.Float
    ) -> tuple[mi.BSDFPtr, mi.UInt32, mi.Float, mi.Bool, mi.Bool]:
        """Draw the fill of an opening; see `gather.paths.Marks.meet`."""
        mine = si.shape == self._panes
        quad = si.prim_index // 2
        count = dr.gather(mi.UInt32, self._count, quad, mine)
        number *= mi.Float(count)
        fill = dr.minimum(mi.UInt32(number), dr.maximum(count, 1) - 1)
        piece = dr.gather(mi.UInt32, self._piece, quad, mine)
        kind = dr.gather(mi.UInt32, self._table, piece * self._fills + fill, mine)
        element = dr.gather(mi.UInt32, self._first, quad, mine) + fill + 1
        chosen = si.bsdf()
        for i, each in enumerate(self._bsdfs):
            chosen = dr.select(mine & (kind == i), mi.BSDFPtr(each), chosen)
        once_more = mark < (1 << BITS * (MEETINGS - 1))
        factor = dr.select(mine, dr.select(once_more, mi.Float(count), 0), 1)
        scatters = mine & dr.gather(mi.Bool, self._scatters, kind, mine)
        has_ended = mark >= DEPOSITED  # but for a film that let it through
        mark = dr.select(mine, (mark << BITS) | element, mark)
        if self._may_split:
            splits = mine & dr.gather(mi.Bool, self._has_lobes, kind, mine)
            ends = number - fill < 0.5
            factor = dr.select(has_ended, 0, dr.select(splits, 2 * factor, factor))
            scatters &= ~splits | ends
            mark = dr.select(splits & ends, mark | DEPOSITED, mark)
        return chosen, mark, factor, mi.Bool(True), scatters


def share_of(mark: mi.UInt32, shares: mi.Float) -> mi.Float:
    """Product of the shares of the elements that paths met [–].

    `shares` are those of nothing, which is 1, and of all elements, shape (1 + element,).
    """
    product = mi.Float(1)
    for meeting in range(MEETINGS):
        met = (mark >> (BITS * meeting)) & MOST_ELEMENTS
        product *= dr.gather(mi.Float, shares, met)
    return product


def elements_of(mark: np.ndarray) -> np.ndarray:
    """Elements that paths met, the last first, counted from 0; −1 for none; (vertex, meeting)."""
    shifts = BITS * np.arange(MEETINGS)
    return ((mark[:, None] >> shifts) & MOST_ELEMENTS).astype(np.int64) - 1


def is_deposited(mark: np.ndarray) -> np.ndarray:
    """Whether paths end at a film with the light that reaches it straight, see `DEPOSITED`."""
    return mark >= DEPOSITED
