"""Examples of the Python reference run, and print what they say; cases are those of the pages."""

import doctest
import importlib
import inspect
import re
from functools import cache, reduce

import pytest

import drcmitsuba
from tests import ROOT
from tests.system.test_docs import write_files

pytestmark = pytest.mark.usefixtures("drawn")
PAGE = ROOT / "docs" / "reference" / "python.md"
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
WITHOUT = (
    "bsdf.measured", "design", "annual.tradeoff", "annual.bench",  # run by pages and notebooks
    "standards.verdict", "standards.Verdict", "standards.ViewOut",  # a year, and what others give
    "rendering.PreparedView", "rendering.Rendering", "picture.glare.Glare", "picture.glare_sources",
    "sky.daylight.Daylight", "controls.space", "annual.elements", "annual.lights", "BackendError",
)  # fmt: skip
"""Names, or their beginnings, without an example: classes that another name's shows."""


def _part(of, name):
    """Attribute of a module, or a module within it that nothing has imported yet."""
    if not hasattr(of, name):
        importlib.import_module(f"{of.__name__}.{name}")
    return getattr(of, name)


def named():
    """Objects of the page, and classes and functions of the package itself, by their names."""
    found = {name: getattr(drcmitsuba, name) for name in drcmitsuba._NAMES}
    found = {name: thing for name, thing in found.items() if callable(thing)}
    for name in re.findall(r"auto\w+:: drcmitsuba\.(\S+)", PAGE.read_text(encoding="utf-8")):
        *rooms, last = name.split(".")
        thing = reduce(_part, rooms, drcmitsuba)
        thing = _part(thing, last)
        found[name] = getattr(thing, last) if inspect.ismodule(thing) else thing
    return found


def doctests():
    """Doctests of the page's names, each object once."""
    parser, seen = doctest.DocTestParser(), {}
    for name, thing in named().items():
        text = inspect.getdoc(thing) or ""
        if ">>>" in text and id(thing) not in seen:
            seen[id(thing)] = parser.get_doctest(text, {}, name, None, None)
    return list(seen.values())


def test_most_names_have_an_example():
    lacking = [name for name, thing in named().items() if ">>>" not in (thing.__doc__ or "")]
    assert len(lacking) <= 23
    assert [name for name in lacking if not name.startswith(WITHOUT)] == []


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with the files of the pages, which examples add to."""
    return write_files(tmp_path_factory.mktemp("examples"))


@pytest.fixture(scope="module")
def evaluate():
    """`drcmitsuba.evaluate` that evaluates each file once: most examples begin with a result."""
    return cache(drcmitsuba.evaluate)


@pytest.mark.parametrize("example", doctests(), ids=lambda example: example.name)
def test_examples_say_what_they_print(example, folder, evaluate, monkeypatch):
    monkeypatch.chdir(folder)
    if example.name != "evaluate":
        monkeypatch.setattr(drcmitsuba, "evaluate", evaluate)
    drcmitsuba.backend.select()
    said = []
    doctest.DocTestRunner(optionflags=FLAGS).run(example, out=said.append)
    assert "".join(said) == ""
