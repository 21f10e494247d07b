"""Constraints of SLSQP on a façade's smooth twins: area of the panes, ASE, glare, a least aim.

Smooth and hard numbers differ. Each limit is therefore shifted by that difference at the start of
a stage: by the hard number less the smooth one, which may be negative.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from drcmitsuba.design.candidate import FacadeCandidate

At = Callable[[np.ndarray], FacadeCandidate]
"""Evaluates x (free,)."""


def area_constraints(
    limits: tuple[float, float] | None,
    area: Callable[[np.ndarray], float],
    slope: Callable[[np.ndarray], np.ndarray],
) -> list[dict[str, Any]]:
    """Constraints on the panes' area over its upper limit; one equality where both limits agree.

    `area` [m²] and its `slope` (free,) are functions of x (free,).
    """
    if limits is None:
        return []
    low, high = limits
    unit = max(high, 1e-9)

    def edge(kind: str, sign: int, limit: float) -> dict[str, Any]:
        return {
            "type": kind,
            "fun": lambda p: sign * (area(p) - limit) / unit,
            "jac": lambda p: sign * slope(p) / unit,
        }

    if low == high:
        return [edge("eq", 1, low)]
    return [edge("ineq", 1, low), edge("ineq", -1, high)]


def limit_constraint(
    name: Literal["ase", "glare"], limit: float, at: At, shift: float
) -> dict[str, Any]:
    """Constraint on a smooth number, whose limit is lowered by the shift [%]."""
    return {
        "type": "ineq",
        "fun": lambda p: (limit - shift - getattr(at(p).smooth, name)) / 100,
        "jac": lambda p: -getattr(at(p), f"{name}_gradient") / 100,
    }


def aim_constraint(least: float, at: At, shift: float) -> dict[str, Any]:
    """Constraint on the smooth aim, whose least value is lowered by the shift [%]."""
    return {
        "type": "ineq",
        "fun": lambda p: (at(p).smooth.aim + shift - least) / 100,
        "jac": lambda p: at(p).aim_gradient / 100,  # type: ignore[operator]
    }
