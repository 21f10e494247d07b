"""The pipeline is the import order: a module imports only modules above it, plugins nothing of it.

Imports inside functions count too; `drcmitsuba/__init__.py` is the table of contents and exempt.
"""

import ast
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from drcmitsuba.case.toml import read_toml

ROOT = Path(__file__).resolve().parents[2]
# fmt: off
ORDER = [
    "errors", "progress", "schema", "weather", "period", "sky", "suns", "table", "lengths",
    "accuracy", "bsdf", "material_table", "component_table", "facade_table", "design_table",
    "effects_table", "sky_table", "shipped", "case", "light", "backend",
    "structures", "materials", "geometry", "coplanar", "components", "reach", "scope", "tally",
    "surfaces", "sensors", "scene", "goniophotometer", "plan", "transport", "coefficients",
    "basis", "refinement", "accumulate", "metrics", "smooth", "uncertainty", "pool", "simulation",
    "judgement", "rounds", "forecast", "design", "plots", "design_pictures", "report", "result",
    "variants", "season", "tradeoff", "terminal", "film_commands", "tradeoff_command",
    "plan_command", "optimise_command", "cli",
]
# fmt: on
FOLDERS = {"drcmitsuba": ROOT / "drcmitsuba", "drcmitsuba_plugins": ROOT / "plugins"}
MODULES = {
    ".".join((package, *file.relative_to(folder).with_suffix("").parts)).removesuffix(
        ".__init__"
    ): file
    for package, folder in FOLDERS.items()
    for file in folder.rglob("*.py")
}


def imports(module):
    """Modules that a module imports; of this project by their own names, others by their top."""
    found = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import in line {node.lineno}"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in MODULES else node.module for name in inner}
    return {name if name in MODULES else name.split(".")[0] for name in found}


def part(module):
    return module.split(".")[1]


@pytest.mark.parametrize("module", sorted(m for m in MODULES if m.startswith("drcmitsuba.")))
def test_a_module_imports_only_modules_above_it(module):
    assert part(module) in ORDER, "give the new module its place in ORDER"
    for name in imports(module):
        if name == "drcmitsuba":  # names of the table of contents, for the command line only
            assert part(module) == "cli"
        elif name.startswith("drcmitsuba.") and part(name) != part(module):
            assert ORDER.index(part(name)) < ORDER.index(part(module)), f"{module} imports {name}"


@pytest.mark.parametrize("module", sorted(m for m in MODULES if "plugins" in m))
def test_plugins_import_nothing_but_mitsuba_drjit_numpy_and_each_other(module):
    # defusedxml: the plugins read BSDF files, which come from strangers.
    allowed = {"mitsuba", "drjit", "numpy", "defusedxml", *sys.stdlib_module_names}
    others = {name for name in imports(module) if not name.startswith("drcmitsuba_plugins")}
    assert others <= allowed


def test_no_import_cycle():
    graph = {module: imports(module) & MODULES.keys() - {module} for module in MODULES}
    TopologicalSorter(graph).prepare()


def test_every_package_is_installed():
    """An installation beside this folder has only the packages that pyproject.toml names."""
    named = set(read_toml(ROOT / "pyproject.toml", 1 << 20)["tool"]["setuptools"]["packages"])
    folders = {file.parent for file in FOLDERS["drcmitsuba"].rglob("__init__.py")}
    there = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    assert there == named - {"drcmitsuba.scenes", "drcmitsuba_plugins"}
