"""Ends of the rays of an eye, and what rays met on their way there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, NamedTuple, TypeVar

import drjit as dr
import mitsuba as mi
import numpy as np

OUTSIDE = 0xFFFFFFFF
"""In place of the part of a scene: none, the ray leaves."""
T = TypeVar("T")


class OnWay(IntFlag):
    """Kinds of surfaces that a ray met before its end; bits."""

    PANE = 1
    """It went through a pane, a gap or a solid's face."""
    TURN = 2
    """It was mirrored, refracted or scattered."""
    MIRRORING_PANE = 4
    """A clear pane mirrored it."""
    ROUGH = 8
    """A rough mirror or a rough solid turned it into a lobe."""
    SCATTERING_PANE = 16
    """A film or a diffusing pane scattered it: what light such panes get from sky and suns is their
    glow."""
    BACK = 32
    """Its end is at the back of the surface."""


class Ends(NamedTuple):
    """Ends of one kind, on the device."""

    ray: mi.UInt32
    """Index of the ray."""
    weight: mi.Float
    """Weight [–]: luminance at the eye per luminance of the end; of surfaces, before their
    reflectance."""
    p: mi.Point3f
    """Place of the end; of the outside, that of the last surface, off it [m]."""
    d: mi.Vector3f
    """Direction of the ray's last part, away from the eye."""
    n: mi.Normal3f
    """Normal of the pane or mirror; of a surface, the one towards the ray."""
    part: mi.UInt32
    """Part of the scene, `OUTSIDE` for none."""
    sun: mi.Float
    """Share of the sun's light along the ray that it counts, see `mirrored_sun` [–]."""
    met: mi.UInt32
    """Bits of `OnWay`."""
    opening: mi.Int32
    """Opening that the ray met first, `NO_OPENING` for none."""
    again: mi.Bool
    """Whether it met another opening afterwards."""

    @classmethod
    def none(cls) -> Ends:
        """No ends."""
        whole, real, vector = mi.UInt32(), mi.Float(), mi.Vector3f(*3 * [mi.Float()])
        return cls(
            whole, real, mi.Point3f(vector), vector, mi.Normal3f(vector), whole, real, whole,
            mi.Int32(), mi.Bool(),
        )  # fmt: skip

    @property
    def front(self) -> mi.Point3f:
        """Places off their surface, on the side of the eye [m]."""
        if dr.width(self.p) == 0:
            return self.p
        far = mi.math.RayEpsilon * (1 + dr.max(dr.abs(self.p)))
        return mi.Point3f(self.p + dr.mulsign(far, -dr.dot(self.n, self.d)) * self.n)

    def rows(self) -> EndRows:
        """Return the same in memory, by ray."""
        columns = (self.ray, self.weight, self.p, self.d, self.n, self.part, self.sun, self.met,
                   self.opening, self.again)  # fmt: skip
        rows = EndRows(*(_in_memory(column) for column in columns))
        return rows.take(np.argsort(rows.ray, kind="stable"))


def _in_memory(column: Any) -> np.ndarray:
    """Column (end,) or (end, axis), in double precision, or as whole numbers with their sign."""
    if dr.depth_v(column) > 1:
        return np.array(column).T.astype(float)
    values = np.asarray(column.numpy())
    if values.dtype == np.uint32:
        values = values.view(np.int32)  # `OUTSIDE` is −1
    kinds = {"b": bool, "f": float, "i": int}
    return values.astype(kinds[values.dtype.kind])


@dataclass(frozen=True)
class EyeEnds:
    """Ends of rays by their kind."""

    outside: Ends
    """Sky, ground and sun."""
    panes: Ends
    """Panes that scatter, and glow."""
    rough: Ends
    """Rough mirrors, which show suns as lobes; rays go on beyond them."""
    surfaces: Ends
    """Surfaces that reflect diffusely."""


class EndRows(NamedTuple):
    """Ends of one kind in memory, by ray."""

    ray: np.ndarray
    """Index of the ray, int, shape (end,)."""
    weight: np.ndarray
    """Weight [–], shape (end,); of surfaces that of their illuminance over π, (end, channel)."""
    point: np.ndarray
    """Place of the end [m], shape (end, 3)."""
    direction: np.ndarray
    """Direction of the ray's last part, away from the eye, shape (end, 3)."""
    normal: np.ndarray
    """Normal as of `Ends`; of a surface on the side whose illuminance counts, shape (end, 3)."""
    part: np.ndarray
    """Index of the scene's part, −1 for the outside, int, shape (end,)."""
    sun: np.ndarray
    """Share of the sun's light that rays count [–], shape (end,)."""
    met: np.ndarray
    """Bits of `OnWay`, int, shape (end,)."""
    opening: np.ndarray
    """Opening that the ray met first, `NO_OPENING` for none, int, shape (end,)."""
    again: np.ndarray
    """Whether it met another opening afterwards, bool, shape (end,)."""

    def take(self, which: np.ndarray) -> EndRows:
        """Some of the ends."""
        return EndRows(*(column[which] for column in self))

    def has_met(self, kind: OnWay) -> np.ndarray:
        """Whether rays met surfaces of some kinds, bool (end,)."""
        return (self.met & kind) > 0

    @classmethod
    def joined(cls, parts: Sequence[EndRows]) -> EndRows:
        """Ends of several kinds, by ray."""
        joined = cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
        return joined.take(np.argsort(joined.ray, kind="stable"))


def taken(columns: T, some: mi.UInt32) -> T:
    """Some entries of a tuple of arrays."""
    parts = (dr.gather(type(column), column, some) for column in columns)  # type: ignore[attr-defined]
    return type(columns)(*parts)


def joined(parts: Sequence[T]) -> T:
    """Tuples of arrays, one after another."""
    if len(parts) == 1:
        return parts[0]
    columns = zip(*parts, strict=True)
    return type(parts[0])(*(_joined(column) for column in columns))


def _joined(arrays: Sequence[Any]) -> Any:
    kind = type(arrays[0])
    if dr.depth_v(kind) > 1:
        return kind(*(dr.concat([a[k] for a in arrays]) for k in range(3)))
    return dr.concat(list(arrays))
