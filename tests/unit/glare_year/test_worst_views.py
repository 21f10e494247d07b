"""The worst view of a space: by its class, then by its hours."""

import pytest
import shapely

from drcmitsuba.glare_year.worst_views import worst_spaces, worst_views
from drcmitsuba.model.space import Space, SpaceFloor

NAMES = ("high", "medium", "minimum", "none")


def row(space, rating, *above):
    shares = dict(zip(("0.35", "0.40", "0.45"), above, strict=True))
    return {
        "space": space, "class": rating, "probability": {rating: 1.0},
        "above": {limit: {"value": value} for limit, value in shares.items()},
    }  # fmt: skip


def test_the_worst_class_counts_before_hours():
    rows = {
        "a1": row("west", "medium", 30, 2, 1), "a2": row("west", "minimum", 20, 9, 2),
        "a3": row("west", "minimum", 10, 9, 4), "b1": row("east", "none", 50, 40, 30),
        "c1": row("hall", "high", 1, 0, 0), "garden": row("", "none", 90, 90, 90),
    }  # fmt: skip
    worst = worst_views(rows, NAMES)
    assert [*worst] == ["east", "west", "hall"]  # most glare first, and no view without a space
    assert (worst["west"]["worst"], worst["west"]["views"]) == ("a2", 3)
    assert worst["west"]["class"] == "minimum"
    assert worst["east"]["above"]["0.45"]["value"] == 30


def test_views_in_no_space_have_none():
    assert worst_views({"garden": row("", "none", 90, 90, 90)}, NAMES) == {}


def test_the_building_has_areas_by_class():
    rows = {"a": row("west", "minimum", 20, 9, 2), "b": row("east", "none", 50, 40, 30),
            "c": row("hall", "minimum", 9, 1, 0)}  # fmt: skip
    spaces = [
        Space(name, (SpaceFloor(0.0, shapely.box(0, 0, length, 1)),))
        for name, length in (("west", 5), ("east", 2), ("hall", 3), ("attic", 90))
    ]
    told = worst_spaces(worst_views(rows, NAMES), spaces, NAMES)
    assert (told["spaces"], told["floor_area"]) == (3, 10)
    assert (told["worst"], told["view"], told["class"]) == ("east", "b", "none")
    assert told["area"] == pytest.approx({"high": 0, "medium": 0, "minimum": 80, "none": 20})
    west = worst_spaces(worst_views(rows, NAMES), spaces[:1], NAMES)
    assert (west["worst"], west["area"]["minimum"]) == ("west", 100)
