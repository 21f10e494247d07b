"""Refusal of lengths that are hardly metres, so that nobody simulates a room of 8 km.

A case with `unit = "m"` insists on its lengths.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drcmitsuba.model.model import Layer
from drcmitsuba.runtime.errors import InputError

HIGHEST, WIDEST = 150.0, 2000.0
"""Largest height, and largest length or width, of a room [m]; no built hall is larger."""
APART = 100.0
"""Largest spacing of sensors under the free sky [m]."""
LARGEST = 200.0
"""Largest extent of a component made of a mesh [m]."""
A_THING = 0.2
"""Smallest extent of furniture in its second largest direction [m]."""
A_BOX, TALLEST = 0.2, 1000.0
"""Smallest extent and largest height of a model without its context [m]."""
FARTHEST = 100_000.0
"""Largest distance from the room, or from the sensors of a case without room [m]."""

INSIST = 'or write unit = "m" at the top of the case if it is so'


def _by(size: Sequence[float]) -> str:
    return " × ".join(f"{v:g}" for v in size)


def ask_about_room(size: Sequence[float]) -> None:
    """Refuse a room that is larger than any building."""
    if size[2] <= HIGHEST and max(size) <= WIDEST:
        return
    by_1000 = size[2] >= 1000 or max(size) > WIDEST
    unit, factor = ("millimetres", 1000) if by_1000 else ("centimetres", 100)
    got = f"{_by(size)} m looks like {unit}"
    raise InputError("case", "room.size", got, f"divide all lengths by {factor}, {INSIST}")


def ask_about_furniture(
    field: str, corner: Sequence[float], size: Sequence[float], room: Sequence[float]
) -> None:
    """Refuse furniture outside of the room that would stand in the room if given in millimetres.

    Pieces that would be specks in the room are taken for buildings outside.
    """
    low, extent, inner = (np.asarray(v, float) for v in (corner, size, room))
    meets_room = ((low < inner) & (low + extent > 0)).all()
    fits = ((low >= 0) & (low + extent <= 1000 * inner)).all()
    if not meets_room and fits and np.sort(extent)[1] >= 1000 * A_THING:
        got = f"{_by(size)} m at {_by(corner)} m looks like millimetres"
        raise InputError("case", field, got, f"divide by 1000, {INSIST}")


def ask_about_spacing(spacing: float) -> None:
    """Refuse sensors under the free sky that are far from each other."""
    if spacing > APART:
        got = f"{spacing:g} m looks like millimetres"
        raise InputError("case", "sensors.spacing", got, f"divide by 1000, {INSIST}")


def ask_about_mesh(source: object, field: str, extent: Sequence[float], scale: float) -> None:
    """Refuse a component as large as a village."""
    if max(extent) > LARGEST:
        got = f"the mesh is {_by([round(v, 3) for v in extent])} m, which looks like millimetres"
        raise InputError(source, field, got, f"give scale = {scale / 1000:g}, {INSIST}")


def ask_about_model(source: object, layers: Sequence[Layer]) -> None:
    """Refuse a model that is, without its context, larger than a town or smaller than a box."""
    near = [layer.quads for layer in layers if layer.role != "context"]
    if not near:
        return
    every = np.concatenate(near).reshape(-1, 3)
    extent = np.ptp(every, axis=0)
    if A_BOX <= extent.max() <= WIDEST and extent[2] <= TALLEST:
        return
    got = f"the model without its context is {_by([float(f'{v:.4g}') for v in extent])} m"
    remedy = 'give the unit of its files in [model], such as unit = "mm", or "m" if it is so'
    raise InputError(source, "model.unit", got, remedy)


def refuse_far(source: object, field: str, points: np.ndarray, around: str) -> None:
    """Refuse points (point, 3) [m], relative to `around`, that lie farther off than `FARTHEST`."""
    far = float(abs(points).max())
    if far > FARTHEST:
        got = f"it lies {far / 1000:.4g} km from {around}"
        raise InputError(source, field, got, "give all coordinates from one origin")
