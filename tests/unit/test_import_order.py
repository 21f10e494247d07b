"""The pipeline is the import order: a room imports only rooms above it, plugins nothing of it.

Within `transport`, a folder imports only folders above it; a class has a name of its own.

Imports inside functions count too; `drcmitsuba/__init__.py` is the table of contents and exempt.
"""

import ast
import re
import sys
from collections import defaultdict
from functools import cache
from graphlib import TopologicalSorter
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOMS = [
    "schema", "runtime", "blocks", "model", "case", "sky", "bsdf", "scene", "colour",
    "goniophotometer", "transport", "eye", "metrics", "controls", "standards", "report", "picture",
    "export", "plan", "annual", "rendering", "glare_year", "design", "cli",
]  # fmt: skip
MOST_FLOORS = 10
FOLDERS = {
    name: Path(find_spec(name).origin).parent for name in ("drcmitsuba", "drcmitsuba_plugins")
}
FILES = {
    file: package
    for package, folder in FOLDERS.items()
    for file in folder.rglob("*.py")
    if "scenes" not in file.relative_to(folder).parts[:1]  # data, beside the rooms of a wheel
}
MODULES = {
    ".".join((package, *file.relative_to(FOLDERS[package]).with_suffix("").parts)).removesuffix(
        ".__init__"
    ): file
    for file, package in FILES.items()
}


@cache
def tree(module):
    """Syntax of a module."""
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


@cache
def imports(module):
    """Modules that a module imports; of this project by their own names, others by their top."""
    names = set()
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import in line {node.lineno}"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in MODULES else node.module for name in inner}
    return {name if name in MODULES else name.split(".")[0] for name in names}


def room(module):
    return module.split(".")[1]


def rooms_imported(module):
    """Rooms other than its own that a module imports."""
    inner = {name for name in imports(module) if name.startswith("drcmitsuba.")}
    return {room(name) for name in inner} - {room(module)}


ENTRY = "drcmitsuba.__main__"
"""Starts the last room."""
OF_ROOMS = sorted(module for module in {*MODULES} - {ENTRY} if module.startswith("drcmitsuba."))


def test_every_entry_of_the_package_is_a_room():
    files = [path for path in FOLDERS["drcmitsuba"].iterdir() if path.suffix in ("", ".py")]
    entries = {path.stem for path in files if path.stem[0] != "_"}
    assert entries - {"scenes"} == set(ROOMS)  # a wheel has its data there
    assert [room for room in ROOMS if not (FOLDERS["drcmitsuba"] / room).is_dir()] == ["schema"]


@pytest.mark.parametrize("module", OF_ROOMS)
def test_a_module_imports_only_rooms_above_its_own(module):
    if "drcmitsuba" in imports(module):  # names of the table of contents
        assert room(module) == "cli"
    for other in rooms_imported(module):
        assert ROOMS.index(other) < ROOMS.index(room(module)), f"{module} imports {other}"


def test_rooms_stand_on_few_floors():
    floors = {}
    for name in ROOMS:
        below = set().union(*(rooms_imported(m) for m in OF_ROOMS if room(m) == name))
        floors[name] = 1 + max((floors[other] for other in below), default=0)
    assert max(floors.values()) <= MOST_FLOORS, floors


TRANSPORT = sorted(module for module in OF_ROOMS if room(module) == "transport")


def folder(module):
    """Folder of a module of `transport`, or the module itself where it joins folders."""
    return ".".join(module.split(".")[:3])


def test_folders_of_transport_import_one_another_without_a_circle():
    graph = defaultdict(set)
    for module in TRANSPORT[1:]:
        graph[folder(module)] |= {folder(m) for m in imports(module) & {*TRANSPORT[1:]}}
    for name, others in graph.items():
        others.discard(name)
    TopologicalSorter(graph).prepare()


def test_modules_of_transport_stand_on_few_floors():
    inner = [m for m in TRANSPORT if MODULES[m].name != "__init__.py"]
    graph, floors = {module: imports(module) & {*inner} for module in inner}, {}
    for module in TopologicalSorter(graph).static_order():
        floors[module] = 1 + max((floors[other] for other in graph[module]), default=0)
    assert max(floors.values()) <= MOST_FLOORS, floors


def test_a_class_name_stands_for_one_class():
    places = defaultdict(list)
    for module in MODULES:
        for node in ast.walk(tree(module)):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(module)
    assert {name: modules for name, modules in places.items() if len(modules) > 1} == {}


def test_a_folder_of_transport_lists_all_its_modules():
    for package in (m for m in TRANSPORT if MODULES[m].name == "__init__.py"):
        below = {m.split(".")[-1] for m in TRANSPORT if m.rpartition(".")[0] == package}
        text = ast.get_docstring(tree(package))
        heads = re.findall(r"^[a-z_0-9]+(?:, [a-z_0-9]+)*$", text, re.MULTILINE)
        assert {name for line in heads for name in line.split(", ")} == below, package


@pytest.mark.parametrize("module", sorted(m for m in MODULES if "plugins" in m))
def test_plugins_import_nothing_but_mitsuba_drjit_numpy_and_each_other(module):
    # defusedxml: the plugins read BSDF files, which come from strangers.
    allowed = {"mitsuba", "drjit", "numpy", "defusedxml", *sys.stdlib_module_names}
    others = {name for name in imports(module) if not name.startswith("drcmitsuba_plugins")}
    assert others <= allowed


def test_no_import_cycle():
    graph = {module: imports(module) & MODULES.keys() - {module} for module in MODULES}
    TopologicalSorter(graph).prepare()


def test_every_folder_with_modules_is_a_package():
    folders = {file.parent for file in FILES}
    assert [folder for folder in folders if not (folder / "__init__.py").is_file()] == []


def test_what_follows_from_a_case_is_found_in_one_place():
    """Groups of panes and sensors are those of `scene.prepared_case`, found once for a case."""
    own = {"scene/prepared_case.py", "scene/sensors.py", "scene/pane_groups.py"}
    finders = re.compile(r"\b(?:sensor_points|sensor_coordinates|PaneGroups\.of(?:_windows)?)\(")
    for file in sorted(FOLDERS["drcmitsuba"].rglob("*.py")):
        if file.relative_to(FOLDERS["drcmitsuba"]).as_posix() not in own:
            assert not finders.findall(file.read_text(encoding="utf-8")), file


def test_the_page_names_all_modules_that_ask_whether_a_case_has_a_room():
    """Nothing keeps a task from a model in silence: each difference stands there."""
    asks = re.compile(r"\b(case|first|self)\.room is (not )?None")
    modules = set()
    package = FOLDERS["drcmitsuba"]
    for path in package.rglob("*.py"):
        lines = path.read_text(encoding="utf-8").splitlines()
        if any(asks.search(line) and "assert" not in line for line in lines):
            modules.add(path.relative_to(package).as_posix())
    page = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text(encoding="utf-8")
    _, after = page.split("## Where rooms of boxes and models differ")
    table = after.split("\n## ")[0]
    assert set(re.findall(r"`([\w/]+\.py)`", table)) == modules
