"""Glare of spaces: the view of each that is dazzled most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


def worst_views(rows: Mapping[str, Mapping[str, Any]], classes: Sequence[str]) -> dict[str, Any]:
    """Worst view of every space, those with most glare first.

    Parameters
    ----------
    rows : mapping of str to mapping
        Numbers of every view in one state, as `GlareYear.numbers` has them, with the key `space`.
    classes : sequence of str
        Names of the classes, the best first.

    Returns
    -------
    dict
        By the name of the space: its number of `views`, the `worst` one, and `class`, `probability`
        and `above` of that one. It is the view of the worst class; of those the one with most hours
        above the DGP of the best class. Views in no space are left out.
    """
    of_space: dict[str, list[str]] = {}
    for view, row in rows.items():
        if row["space"]:
            of_space.setdefault(row["space"], []).append(view)

    def glare(view: str) -> tuple[float, ...]:
        row = rows[view]
        return classes.index(row["class"]), *(share["value"] for share in row["above"].values())

    worst = {space: max(views, key=glare) for space, views in of_space.items()}
    return {
        space: {
            "views": len(of_space[space]),
            "worst": worst[space],
            **{key: rows[worst[space]][key] for key in ("class", "probability", "above")},
        }
        for space in sorted(worst, key=lambda space: glare(worst[space]), reverse=True)
    }
