"""The schema of a recipe describes every key, lengths in millimetres and angles in degrees."""

from drcmitsuba.scene.structures.recipe import Recipe

SCHEMA = Recipe.model_json_schema()
TABLES = {"Recipe": SCHEMA, **SCHEMA["$defs"]}


def test_every_key_of_a_recipe_is_described():
    bare = [
        f"{name}.{key}"
        for name, table in TABLES.items()
        for key, field in table["properties"].items()
        if "description" not in field
    ]
    assert bare == []


def test_lengths_and_angles_have_units():
    lengths = ("period", "thickness", "slot", "depth", "width", "scale", "distance")
    for table in TABLES.values():
        for key, field in table["properties"].items():
            if key in lengths:
                assert "[mm]" in field["description"], key
            if key in ("tilt", "turn"):
                assert "[deg]" in field["description"], key
