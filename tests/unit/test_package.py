"""Several files that describe the package agree, or one of them says it for all."""

import ast
import re
from importlib import metadata, resources

import pytest

import drcmitsuba
from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.runtime.toml import tomllib
from tests import ROOT

ENTRIES = re.compile(r"^(\w[\w, ]*)\n    \S", re.MULTILINE)
"""Names in a list of contents, over an indented description."""
ROOMS = sorted({file.parent for file in (ROOT / "drcmitsuba").rglob("*/__init__.py")})
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
RENAMED = {"matplotlib": "matplotlib-base", "openexr": "openexr-python", "pvlib": "pvlib-python"}
"""Names of conda-forge for packages of PyPI."""


def name_of(requirement):
    return re.match(r"[\w.-]+", requirement)[0].lower().replace("_", "-")


@pytest.mark.parametrize("folder", ROOMS, ids=lambda folder: folder.name)
def test_a_list_of_contents_is_whole(folder):
    """Every module and folder of a room stands in its list, and nothing that is not there."""
    tree = ast.parse((folder / "__init__.py").read_text("utf-8"))
    contents = ast.get_docstring(tree) or ""
    listed = [name for names in ENTRIES.findall(contents) for name in names.split(", ")]
    modules = {file.stem for file in folder.glob("*.py")} - {"__init__", "__main__"}
    modules |= {file.parent.name for file in folder.glob("*/__init__.py")}
    public = {
        alias.name for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert modules - {*listed} == set()
    assert {*listed} - modules - public == set()
    assert len({*listed}) == len(listed)


def test_the_version_stands_in_one_place():
    assert drcmitsuba.__version__ == metadata.version("drcmitsuba")
    assert PROJECT["dynamic"] == ["version"]
    assert not re.search(r"^version:", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE)


@pytest.mark.parametrize("extra", [None, "llvm", "ifc", "cluster"])
def test_the_licence_of_each_package_is_told(extra):
    needed = PROJECT["optional-dependencies"][extra] if extra else PROJECT["dependencies"]
    page = (ROOT / "docs" / "reference" / "licences.md").read_text("utf-8")
    told = set(re.findall(r"^\| ([\w.-]+) \|", page, re.MULTILINE))
    elsewhere = {"llvm-nanobind", "tomli"}  # of other platforms and versions of Python
    assert {name_of(requirement) for requirement in needed} - told <= elsewhere


def test_the_recipe_of_conda_asks_for_the_same_packages():
    recipe = (ROOT / "docs" / "packaging" / "recipe.yaml").read_text("utf-8")
    run = recipe.partition("\n  run:\n")[2].partition("\n\n")[0]
    asked = {
        (name.lower().replace("_", "-"), bounds)
        for name, bounds in re.findall(r"- ([\w-]+) ?(.*)", run)
    }
    asked -= {("python", ">=${{ python_min }}"), ("libllvm19", "")}
    ours = set()
    for requirement in PROJECT["dependencies"]:
        name, text = name_of(requirement), re.split(r"[;\s]", requirement)[0]
        ours.add((RENAMED.get(name, name), text[len(name) :]))
    assert asked == ours


def test_all_is_every_extra_of_users():
    users = {"llvm", "ifc", "cluster"}
    assert PROJECT["optional-dependencies"]["all"] == ["drcmitsuba[llvm,cluster,ifc]"]
    assert users <= set(PROJECT["optional-dependencies"])


@pytest.mark.parametrize(
    ("package", "file"),
    [
        ("drcmitsuba", "py.typed"),
        ("drcmitsuba.case", "new.toml"),
        ("drcmitsuba.case", "uses.toml"),
        ("drcmitsuba.report.document", "templates/page.html"),
    ],
)
def test_the_package_carries_its_data(package, file):
    assert resources.files(package).joinpath(file).is_file()


@pytest.mark.parametrize("file", ["classroom/existing.toml", "films/prism.xml", "prism/panel.xml"])
def test_the_package_carries_its_scenes(file):
    assert (shipped_folder() / file).is_file()
