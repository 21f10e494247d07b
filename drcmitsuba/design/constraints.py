"""Constraints of SLSQP on a façade's smooth twins: area of the panes, ASE, glare, a least aim.

Smooth and hard numbers differ, so the limits of ASE, of glare and of the aim are shifted by their
difference at the start of a stage.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from drcmitsuba.design.problem import FacadeCandidate

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


def ase_constraint(limit: float, at: At, start: FacadeCandidate) -> dict[str, Any]:
    """Constraint on the smooth ASE, whose limit is lowered by hard − smooth ASE at the start."""
    shift = start.hard.ase - start.smooth.ase
    return {
        "type": "ineq",
        "fun": lambda p: (limit - shift - at(p).smooth.ase) / 100,
        "jac": lambda p: -at(p).ase_gradient / 100,
    }


def glare_constraint(limit: float, at: At, start: FacadeCandidate) -> dict[str, Any]:
    """Constraint on the smooth hours of glare, whose limit is lowered as that of ASE."""
    assert start.hard.glare is not None
    assert start.smooth.glare is not None
    shift = start.hard.glare - start.smooth.glare
    return {
        "type": "ineq",
        "fun": lambda p: (limit - shift - at(p).smooth.glare) / 100,  # type: ignore[operator]
        "jac": lambda p: -at(p).glare_gradient / 100,  # type: ignore[operator]
    }


def aim_constraint(least: float, at: At, start: FacadeCandidate) -> dict[str, Any]:
    """Constraint on the smooth aim, whose least value is raised by smooth − hard at the start."""
    shift = start.hard.aim - start.smooth.aim
    return {
        "type": "ineq",
        "fun": lambda p: (at(p).smooth.aim + shift - least) / 100,
        "jac": lambda p: at(p).aim_gradient / 100,  # type: ignore[operator]
    }
