"""Pages that name much of the program: what they name exists, and their pictures are small."""

import importlib.util
import re
from pkgutil import resolve_name

import pytest
import typer
from PIL import Image

from drcmitsuba.case.case import Case
from drcmitsuba.case.shipped import shipped_cases, shipped_recipes
from drcmitsuba.cli.main import app_of
from drcmitsuba.runtime.toml import tomllib
from tests import ROOT

DOCS = ROOT / "docs"
COMMANDS = typer.main.get_command(app_of()).commands
SCHEMA = Case.model_json_schema()
ROW = re.compile(r"^\| (?P<there>.+?) \| (?P<here>.+?) \| ", re.MULTILINE)
SPAN = re.compile(r"`([^`]+)`")


def options(command):
    """All names of the options of a command."""
    return {name for p in COMMANDS[command].params for name in p.opts if name.startswith("-")}


def keys(schema):
    """Names of the keys of a table, or of the tables that may stand in its place."""
    found = set(schema.get("properties", {}))
    if "$ref" in schema:
        found |= keys(SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]])
    for inner in (schema.get("additionalProperties"), *schema.get("anyOf", ())):
        found |= keys(inner) if isinstance(inner, dict) else set()
    for inner in (*schema.get("oneOf", ()), *([schema["items"]] if "items" in schema else ())):
        found |= keys(inner)
    return found


def fault(span):
    """Part of a name in the middle column that does not exist; empty where all of it does."""
    if match := re.fullmatch(r"\[(\w+)\] (\w+)", span):
        table = SCHEMA["properties"].get(match[1], {})
        return "" if match[2] in keys(table) else f"{match[1]} has {sorted(keys(table))}"
    if span.startswith("drcmitsuba."):
        try:
            resolve_name(span)
        except (AttributeError, ImportError) as error:
            return str(error)
        return ""
    program, verb, *more = *span.split(), ""
    if program != "drcmitsuba" or verb not in COMMANDS:
        return "no verb"
    return " ".join(set(filter(None, more)) - options(verb))


def test_every_equivalent_exists():
    text = (DOCS / "howto" / "coming_from.md").read_text(encoding="utf-8")
    rows = [row for row in ROW.findall(text) if row[1] not in ("here", "–")]
    assert len(rows) > 50
    faults = {span: fault(span) for _, here in rows for span in SPAN.findall(here)}
    assert {span: said for span, said in faults.items() if said} == {}
    assert [here for _, here in rows if not SPAN.search(here)] == []


def test_a_wrong_equivalent_would_be_noticed():
    wrong = ("[period] hour", "[nothing] hours", "drcmitsuba evaluate --bounces", "drcmitsuba.sda")
    assert all(map(fault, (*wrong, "drcmitsuba simulate", "rcontrib")))


@pytest.fixture(scope="module")
def gallery():
    """The script that makes the pictures of the gallery, which reads its page."""
    spec = importlib.util.spec_from_file_location("gallery", DOCS / "gallery.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_gallery_has_ten_cases_that_can_be_run(gallery):
    text = gallery.PAGE.read_text(encoding="utf-8")
    assert len(gallery.entries()) == text.count("\n## ") >= 10
    files = {path.name for path in gallery.CASES.iterdir()}
    for _, commands, _ in gallery.entries():
        for verb, source, *more in commands:
            assert {word for word in more if word.startswith("-")} <= options(verb)
            if source not in ("panel.xml", "existing", "o3", "duct", "corner"):  # made before
                assert source in {*shipped_cases(), *shipped_recipes(), *files}
    assert {name for name in files if name not in text} == set()


def test_the_gallerys_cases_are_valid(gallery):
    for path in gallery.CASES.glob("*.toml"):
        Case.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))


def test_pictures_of_the_gallery_are_there_and_small(gallery):
    named = {name for *_, name in gallery.entries()}
    assert {path.name for path in gallery.PICTURES.iterdir()} == named
    for name in named:
        assert (gallery.PICTURES / name).stat().st_size <= gallery.LARGEST
        with Image.open(gallery.PICTURES / name) as picture:
            assert min(picture.size) > 200
