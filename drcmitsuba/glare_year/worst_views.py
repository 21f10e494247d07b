"""Glare of spaces, storeys and a building: the view of each that is dazzled most, and areas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from drcmitsuba.model.space import Space


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


def worst_spaces(
    worst: Mapping[str, Mapping[str, Any]], spaces: Sequence[Space], classes: Sequence[str]
) -> dict[str, Any]:
    """Worst space of several, and how much of their floor is in each class.

    Parameters
    ----------
    worst : mapping of str to mapping
        Worst view of every space, from `worst_views`.
    spaces : sequence of Space
        Spaces of a storey or of the building; those without views are left out.
    classes : sequence of str
        Names of the classes, the best first.

    Returns
    -------
    dict
        Number of `spaces` with views and their `floor_area` [m²]; the `worst` one, its `view` and
        `class`; `area` in each class of the worst views, by the name of the class [%].
    """
    area = {space.name: space.floor_area for space in spaces if space.name in worst}
    first = next(name for name in worst if name in area)  # they lie in order
    whole = sum(area.values())
    of_class = {
        name: sum(own for space, own in area.items() if worst[space]["class"] == name)
        for name in classes
    }
    return {
        "spaces": len(area), "floor_area": round(whole, 3), "worst": first,
        "view": worst[first]["worst"], "class": worst[first]["class"],
        "area": {name: 100 * own / whole for name, own in of_class.items()},
    }  # fmt: skip
