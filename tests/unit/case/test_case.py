"""The case file: what is right loads, every slip of the pen gives one line that helps."""

import json
import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.case.reading import MAX_BYTES, case_of_settings, load_case
from drcmitsuba.case.shipped import shipped_cases
from drcmitsuba.runtime.errors import InputError
from tests import skips

CASE = """
name = "small"
[period]
months = [3, 6]
[room]
size = [4.0, 5.0, 3.0]
[facade.south]
segments = 2
frame = 0.1
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.shade]
type = "diffuser"
transmittance = 0.1
[[furniture]]
name = "desk"
corner = [1.0, 1.0, 0.7]
size = [1.2, 0.6, 0.04]
reflectance = 0.5
[sensors]
corner = [0.5, 0.5, 0.8]
count = [5, 5]
spacing = 0.6
[shading]
material = "shade"
"""


@pytest.fixture
def load(tmp_path):
    def load(text):
        file = tmp_path / "case.toml"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load_case(file)

    return load


def changed(old, new):
    assert CASE.count(old) == 1, f"{old!r} does not name one place"
    return CASE.replace(old, new)


def complaint(load, text):
    """Message about a case, its file name cut off; it must be one printable line of fair length."""
    with pytest.raises(InputError) as caught:
        load(text)
    line = str(caught.value)
    assert line.isprintable()
    assert len(line) < 400 + len(caught.value.source)
    assert line.startswith(caught.value.source)
    assert caught.value.source.endswith("case.toml")
    assert all((caught.value.field, caught.value.got, caught.value.remedy))
    return line.removeprefix(f"{caught.value.source}: ")


def test_a_case_is_what_its_file_says(load):
    case = load(CASE)
    assert case.name == "small"
    assert case.room.size == (4, 5, 3)
    assert case.facade["south"].strips[0].material == "glass"
    assert case.source.endswith("case.toml")
    assert case.accuracy.replicates == 6
    with pytest.raises(ValueError, match="frozen"):
        case.name = "other"


def test_shipped_cases_load_by_name():
    names = shipped_cases()
    assert {"classroom/existing", "classroom/o1", "classroom/reference/existing"} <= set(names)
    for name in names:
        case = load_case(name)
        assert case.room is not None
        assert case.facade or case.components


def test_a_file_may_have_a_byte_order_mark_and_windows_line_ends(load):
    text = CASE.replace("\n", "\r\n").encode("utf-8-sig")
    assert load(text).model_dump() == load(CASE).model_dump()


@pytest.mark.parametrize(
    ("old", "new", "field", "hint"),
    [
        ("segments", "segmens", "facade.south.segmens", 'did you mean "segments"?'),
        ("[shading]", "[shadng]", "shadng", 'did you mean "shading"?'),
        ("count =", "cuont =", "sensors.cuont", 'did you mean "count"?'),
        ("transmittance = 0.65", "transmitance = 0.65", "glass.transmitance", '"transmittance"?'),
        ("name = \"desk\"", "label = 1", "furniture.0.label", "remove it"),
        ('"glass" }', '"glas" }', "facade.south.strips, 0.9 to 2.7 m", 'did you mean "glass"?'),
        ('material = "shade"', 'material = "shad"', "shading.material", 'did you mean "shade"?'),
        ("facade.south", "facade.souht", "facade.souht", "'south', 'east', 'north' or 'west'"),
        ('"glazing"', '"glasing"', "materials.glass.type", 'did you mean "glazing"?'),
        ('"glazing"', '"wood"', "materials.glass.type", 'choose from: "glazing", "diffuser"'),
    ],
)  # fmt: skip
def test_a_misspelt_word_is_named_with_what_was_meant(load, old, new, field, hint):
    line = complaint(load, changed(old, new))
    assert field in line.split(": ")[0]
    assert hint in line


def test_a_hint_never_comes_from_another_table(load):
    # `paths` of [accuracy] is the nearest word of the whole file, and no key of a sky
    line = complaint(load, CASE + '[sky]\nmodel = "perez"\npatch = "mean"\n')
    assert line == "sky.patch: unknown key; remove it"
    line = complaint(load, changed("[facade.south]", "frame = 0.1\n[facade.south]"))
    assert line == "room.frame: unknown key; remove it"


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("reflectance = 0.5", "reflectance = 1.2", "furniture.0.reflectance: got 1.2; input "
         "should be less than or equal to 1 or a valid list"),
        ("reflectance = 0.5", "reflectance = [0.1, 0.2, 1.2]",
         "furniture.0.reflectance.2: got 1.2; input should be less than or equal to 1"),
        ("reflectance = 0.5", "reflectance = [0.1, 0.2]",
         "furniture.0.reflectance.2: got nothing; field required"),
        ("= 0.65", "= -0.1", "materials.glass.transmittance: got -0.1; input should be greater "
         "than or equal to 0"),
        ("= 0.65", "= 0.65\nreflectance = 0.5", "materials.glass.transmittance + reflectance: "
         "0.65 + 0.5 is above 1; lower one of them"),
        ("transmittance = 0.1", "transmittance = 0.1\nreflectance = 0.95",
         "materials.shade.transmittance + reflectance: 0.1 + 0.95 is above 1; lower one of them"),
        ("= 0.65", "= 70", "materials.glass.transmittance: got 70; did you mean 0.7?"),
        ("reflectance = 0.5", "reflectance = [20, 0.2, 0.3]", "furniture.0.reflectance.0: got 20; "
         "did you mean 0.2?"),
        ('type = "glazing"\n', "", "materials.glass.type: got nothing; say which it is"),
        ("[3, 6]", "[]", "period.months: got []; give at least 1"),
        ("[4.0, 5.0, 3.0]", "[-4.0, 5.0, 3.0]", "room.size.0: got -4.0; input should be greater "
         "than 0"),
        ("[4.0, 5.0, 3.0]", "[4.0, 0, 3.0]", "room.size.1: got 0; input should be greater than 0"),
        ("[4.0, 5.0, 3.0]", "[4.0, 5.0]", "room.size.2: got nothing; field required"),
        ("[4.0, 5.0, 3.0]", "[nan, 5.0, 3.0]", "room.size.0: got NaN; input should be a finite "
         "number"),
        ("[4.0, 5.0, 3.0]", "[inf, 5.0, 3.0]", "room.size.0: got Infinity; input should be a "
         "finite number"),
        ("[4.0, 5.0, 3.0]", "[1e300, 5.0, 3.0]", "room.size.0: got 1e+300; input should be less "
         "than or equal to 100000"),
        ("[4.0, 5.0, 3.0]", '"4 × 5 × 3"', 'room.size: got "4 × 5 × 3"; input should '
         "be a valid list"),
        ("[4.0, 5.0, 3.0]", '["4", 5.0, 3.0]', 'room.size.0: got "4"; input should be a valid '
         "number"),
        ("[4.0, 5.0, 3.0]", "[true, 5.0, 3.0]", "room.size.0: got true; input should be a valid "
         "number"),
        ("[room]", "[[room]]", 'room: got [{"size": [4.0, 5.0, 3.0]}]; input should be a valid '
         "table"),
        ("segments = 2", "segments = 0", "facade.south.segments: got 0; input should be greater "
         "than or equal to 1"),
        ("segments = 2", "segments = 1.5", "facade.south.segments: got 1.5; input should be a "
         "valid integer, got a number with a fractional part"),
        ("segments = 2", "segments = 99999999999999999999", "facade.south.segments: got "
         "99999999999999999999; input should be less than or equal to 200"),
        ("frame = 0.1", "frame = -0.1", "facade.south.frame: got -0.1; input should be greater "
         "than or equal to 0"),
        ("[3, 6]", "[13]", "period.months.0: got 13; input should be less than or equal to 12"),
        ("[5, 5]", "[5000, 5]", "sensors.count.0: got 5000; input should be less than or equal "
         "to 2000"),
        ("count = [5, 5]\n", "", "sensors.count: got nothing; field required"),
        ("top = 2.7", "top = 3.7", "facade.south.strips, 0.9 to 3.7 m: the room is 3 m high; "
         "lower the top"),
        ("top = 2.7", "top = 0.7", "facade.south.strips.0.top: 0.7 m is not above the bottom, "
         "0.9 m; give the higher edge as top"),
        ("strips = [", 'strips = [{ bottom = 2, top = 2.9, material = "wall" }, ',
         "facade.south.strips, 2 to 2.9 m: overlaps the strip below it; start at 2.7 m or above"),
        ("frame = 0.1", "frame = 1.8", "facade.south.strips, 0.9 to 2.7 m: a frame of 1.8 m "
         "leaves no pane; give a narrower frame, fewer segments or a higher strip"),
        ("frame = 0.1", "frame = 5", "facade.south.strips, 0.9 to 2.7 m: a frame of 5 m "
         "leaves no pane; give a narrower frame, fewer segments or a higher strip"),
        ('material = "shade"', 'material = "glass"', 'shading.material: "glass" is no diffuser '
         'or bsdf in [materials]; choose from: "shade"'),
        ("[materials.shade]", "[materials.open]", "materials.open: strips use this name for no "
         "material; choose another name"),
        ("[room]\nsize = [4.0, 5.0, 3.0]", "", "facade: there is no room; add a [room]"),
    ],
)  # fmt: skip
def test_a_wrong_value_gives_its_place_and_a_remedy(load, old, new, line):
    assert complaint(load, changed(old, new)) == line


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (changed("[room]", "[room"), "TOML: Expected ']' at the end of a table declaration (at "
         "line 5, column 6); correct the syntax"),
        (changed("segments = 2", "segments = 2\nsegments = 3"), "TOML: Cannot overwrite a value "
         "(at line 9, column 13); correct the syntax"),
        (changed("small", "Genève").encode("latin-1"), "byte 12: not UTF-8; save as UTF-8"),
        (CASE.encode() + b"\0", "TOML: Invalid statement (at line 28, column 1); correct the "
         "syntax"),
        ("", "sensors: got nothing; field required"),
        (CASE + "#" * MAX_BYTES, f"size: {len(CASE) + MAX_BYTES} bytes; keep below {MAX_BYTES}"),
        (CASE + "x = " + "[" * 5000 + "]" * 5000, None),
        (CASE + f"[accuracy]\nseed = 1{5000 * '0'}\n", None),
        (CASE + f"[accuracy]\nseed = 1{400 * '0'}\n", None),
        (CASE + "x = " + "[" * 200 + "]" * 200, "shading.x: unknown key; remove it"),
        (CASE + '"' + 5000 * "k" + '" = 1', None),
        (CASE + '"a\\nb\\u001b[31m" = 1', 'shading."a\\nb\\u001b[31m": unknown key; remove it'),
        (changed('"glass" }', '"a\\nb\\u001b[31m" }'), None),
    ],
    ids=["syntax", "twice", "latin-1", "zero", "empty", "big", "deep", "digits", "huge", "nested",
         "long-key", "escape-key", "escape-name"],
)  # fmt: skip
def test_a_file_that_is_no_case_gives_one_line(load, text, line):
    message = complaint(load, text)
    assert line is None or message == line


@settings(
    derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.integers(0, len(CASE)),
    st.integers(0, 30),
    st.one_of(st.binary(max_size=12), st.text("0123456789.-+e[]{}=\"'\n#,", max_size=12)),
)
def test_a_damaged_file_loads_or_gives_one_line(load, start, length, instead):
    instead = instead if isinstance(instead, bytes) else instead.encode()
    text = CASE.encode()
    message = ""
    try:
        load(text[:start] + instead + text[start + length :])
    except InputError as error:
        message = str(error)
    assert message.isprintable()


def test_a_missing_file_gives_the_shipped_case_that_was_meant(tmp_path):
    with pytest.raises(InputError, match=r"case file: no such file; give a case or a building$"):
        load_case(tmp_path / "none.toml")
    with pytest.raises(InputError, match=r"case file: no such file; give a case or a building$"):
        load_case(tmp_path)
    with pytest.raises(InputError, match="did you mean the shipped case classroom/existing"):
        load_case("classroom/exsting")


@skips.POSIX.mark
@skips.ORDINARY_USER.mark
def test_an_unreadable_file_is_refused(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(CASE)
    file.chmod(0)
    with pytest.raises(InputError, match="Permission denied; check its path and rights"):
        load_case(file)


def test_a_weather_file_lies_beside_its_case(load, tmp_path):
    case = load(CASE + '[weather]\nfile = "sub/town.epw"\n')
    assert case.path(case.weather.file) == tmp_path / "sub" / "town.epw"
    absolute = load(CASE + f"[weather]\nfile = '{tmp_path / 'town.epw'}'\n")
    assert absolute.path(absolute.weather.file) == tmp_path / "town.epw"


def test_another_weather_file_is_looked_for_where_the_user_is(load, tmp_path, monkeypatch):
    case = load(CASE + '[weather]\nfile = "town.epw"\n')
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    other = case.with_weather(Path("other.epw"))
    assert other.path(other.weather.file) == tmp_path / "here" / "other.epw"
    assert other.source == case.source
    assert case.weather.file == Path("town.epw")
    assert case.with_weather(None) is case


UNIT = r"\[(m|deg|lx|h|s|–|%|1/m|W/m²|K)\]"


def properties(schema):
    """Each property of a JSON schema with the name of its table."""
    for name, table in {"Case": schema, **schema["$defs"]}.items():
        for key, described in table.get("properties", {}).items():
            yield f"{name}.{key}", described


def types(described):
    """Types of the plain values that a property holds."""
    if isinstance(described, list):
        return set().union(*map(types, described))
    if not isinstance(described, dict):
        return set()
    own = {described["type"]} if isinstance(described.get("type"), str) else set()
    return own.union(*(types(v) for k, v in described.items() if k not in ("default", "const")))


def test_every_key_of_the_schema_is_described_and_every_length_has_its_unit():
    keys = dict(properties(Case.model_json_schema()))
    assert len(keys) > 140
    assert [key for key, described in keys.items() if not described.get("description")] == []
    numbers = {key: d["description"] for key, d in keys.items() if "number" in types(d)}
    assert len(numbers) > 60
    assert [key for key, text in numbers.items() if not re.search(UNIT, text)] == []


def test_the_json_schema_describes_the_tables_and_is_valid():
    schema = Case.model_json_schema()
    assert json.loads(json.dumps(schema, allow_nan=False)) == schema
    assert schema["additionalProperties"] is False
    assert set(schema["properties"]) == set(Case.model_fields)
    assert schema["required"] == ["sensors"]
    references = {part for part in json.dumps(schema).split('"') if part.startswith("#/$defs/")}
    assert references == {f"#/$defs/{name}" for name in schema["$defs"]}
    assert "frame" in schema["$defs"][Facade.__name__]["properties"]


def test_a_table_that_states_more_is_another_one():
    """Numbers of samples that are stated hold; those by default follow the number of points."""
    case = Case.model_validate({"sensors": {"corner": (0, 0, 1), "count": (2, 2)}})
    assert case.with_tables(accuracy=Accuracy()) is case
    stated = case.with_tables(accuracy=Accuracy(paths=Accuracy().paths))
    assert stated is not case
    assert stated.accuracy.model_fields_set == {"paths"}


MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl glass\nf 1 2 3\n"


def test_files_of_a_case_are_known_from_any_folder(tmp_path, monkeypatch):
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "room.obj").write_text(MESH)
    text = '[model]\nfiles = ["room.obj"]\nunit = "m"\n[materials.{}]\ntype = "glazing"\n'
    text += "transmittance = 0.6\n[sensors]\npoints = [[0, 0, 1]]\n"
    text += "[model.reflectances]\nglass = 0.5\n"
    (tmp_path / "c" / "case.toml").write_text(text.format("glas"))
    monkeypatch.chdir(tmp_path)
    case = load_case("c/case.toml")
    assert case.model.files == (tmp_path / "c" / "room.obj",)
    (note,) = [note for note in case.building.notes if "[materials]" in note]
    assert note.startswith('no surface of the model has the material "glas" of [materials]')
    assert note.endswith('did you mean "glass"?')
    state = '[groups.pane]\npanes = ["glass"]\nstates = ["glas"]\n'
    (tmp_path / "c" / "case.toml").write_text(text.format("glas") + state)
    assert not any("[materials]" in note for note in load_case("c/case.toml").building.notes)


@pytest.mark.parametrize("name", shipped_cases())
def test_the_settings_of_results_are_a_case_again(name):
    """Results hold all keys with their defaults; a design, which has those of its kind, is left."""
    case = load_case(name)
    stored = json.loads(json.dumps(case.model_dump(mode="json", exclude_none=True)))
    again = case_of_settings({**stored, "case": case.source, "weather_source": ""}, "results")
    left = {"design"}
    assert again.model_dump(exclude=left) == case.model_dump(exclude=left)
    assert again.design is None
