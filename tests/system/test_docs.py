"""README and docs: every block runs as it stands, and every link leads somewhere.

The blocks of a page run in order in one folder. A block with a file name is written there; a `toml`
block without one is a piece of a case: together with the page's case it has to be a valid one. To
save time, cases of the pages are evaluated for few hours at few points with few samples, searches
are short, pictures are small, and one process runs the commands and the Python of all pages.
"""

import re
import shutil

import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.runtime.toml import checked, tomllib
from tests import ROOT, radiance, skips
from tests.hard.command_line import CommandLine
from tests.unit.bsdf.test_bsdf_measured import measure, through
from tests.unit.model import gbxml_building
from tests.unit.sky.test_weather import epw, wea

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
GENERATED = {"case_keys.md", "command_line.md"}
PAGES = [path for path in PAGES if path.name not in GENERATED and "_build" not in path.parts]
BLOCK = re.compile(r"^```(\w+)(?: ([\w.]+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[\w-]+)?\)")
FAST = {
    "period": {"months": [3], "hours": [11, 13]},
    "accuracy": {"paths": 16, "cell_sky_rays": 16, "sensor_sky_rays": 16, "photons": 16},
}
"""Tables that make the cases of the pages quick, where a page does not set them itself."""
FEWER = {
    "count = [10, 10]\nspacing = 0.5": "count = [4, 4]\nspacing = 1.25",
    "[design]": "[design]\niterations = 4\nsharpness = [4, 16]\npareto = 2",
}
"""Parts of the pages' cases, and what makes them quick."""
SMALLER = {"--size 288x198": "--size 72x50", "--size 128": "--size 48"}
"""Sizes of the pages' pictures, and what makes them quick."""
SHAPE = """v 0 0 0
v 100 0 0
v 0 100 0
v 0 0 100
f 1 3 2
f 1 2 4
f 2 3 4
f 1 4 3
"""


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def blocks(path, *languages):
    """Language, file name and text of the blocks of a page."""
    return [m.groups() for m in BLOCK.finditer(path.read_text("utf-8")) if m[1] in languages]


def named(file):
    """Text of the block that has a file name, the one of the tutorial first."""
    pages = sorted(PAGES, key=lambda path: path.name != "tutorial.md")
    return next(t for page in pages for _, name, t in blocks(page, "toml", "text") if name == file)


def quick(text):
    """Case text with the parts of FEWER, and the tables of FAST that it does not have."""
    for old, new in FEWER.items():
        text = text.replace(old, new)
    lines = [text]
    for table, keys in FAST.items():
        if f"[{table}]" not in text:
            lines += [f"[{table}]", *(f"{key} = {value}" for key, value in keys.items())]
    return "\n".join(lines) + "\n"


def write(folder, name, text):
    """Write the file of a named block."""
    is_case = "[sensors]" in text
    (folder / name).write_text(quick(text) if is_case else text, encoding="utf-8")


@pytest.fixture
def folder(tmp_path):
    """Folder with the files that the pages take for granted."""
    return write_files(tmp_path)


def write_files(tmp_path):
    """Write the files that the pages take for granted to a folder, which is returned."""
    cases = ("office.toml", "film_office.toml", "corner_office.toml", "studio.toml", "desk.toml")
    for name in (*cases, "painted.toml", "my_prism.toml", "studio.rad", "frames.csv", "study.toml"):
        write(tmp_path, name, named(name))
    sun = '\n[sun]\nmodel = "adaptive"\nfinest = 4\ntolerance = 0.5\n'
    write(tmp_path, "adaptive.toml", named("office.toml") + sun)
    scenes = ROOT / "scenes"
    shutil.copy(scenes / "films" / "prism.xml", tmp_path / "film.xml")
    shutil.copy(scenes / "lamella" / "recipe.toml", tmp_path / "lamellae.toml")
    (tmp_path / "shape.obj").write_text(SHAPE)
    gbxml_building.written(tmp_path, gbxml_building.text(gbxml_building.surfaces().values()))
    (tmp_path / "my_weather.epw").write_text("\n".join(epw()) + "\n")
    stamps = [f"3 2 {11 + minute / 60:.3f} 500 100" for minute in range(0, 120, 10)]
    place = {"latitude": "36.1", "longitude": "79.95", "time_zone": "75.0"}  # of the default year
    (tmp_path / "ten_minutes.wea").write_text("\n".join(wea(*stamps, **place)) + "\n")
    return tmp_path


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_links_lead_somewhere(path):
    targets = [t for t in LINK.findall(path.read_text("utf-8")) if "://" not in t]
    generated = {"case_keys.md", "command_line.md", "_static/rooms.svg"}
    missing = [t for t in targets if not (path.parent / t).exists()]
    assert [t for t in missing if not t.endswith(tuple(generated))] == []


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_pieces_of_cases_are_valid(path, folder):
    pieces = [text for _, name, text in blocks(path, "toml") if name is None]
    for piece in pieces:
        case = tomllib.loads((folder / "office.toml").read_text("utf-8"))
        for table, values in tomllib.loads(piece).items():
            old = case.get(table)
            case[table] = {**old, **values} if isinstance(old, dict) else values
        case["materials"].setdefault("film", {"type": "bsdf", "file": "film.xml"})
        checked(Case, case, "block")


@pytest.fixture(scope="module")
def command():
    """The command line, in a process that stays: Mitsuba is imported once."""
    process = CommandLine()
    yield process
    process.close()


def runs(block):
    """Whether a block holds anything that a test can run."""
    language, _, text = block
    return language == "python" or any(
        line.startswith("drcmitsuba ") and "CASE" not in line for line in text.splitlines()
    )


def runnable(path):
    """Blocks of a page that a test can run."""
    return [block for block in blocks(path, "sh", "python") if runs(block)]


LONG = "film_design", "glare", "groups", "pictures", "sizing"
"""Pages whose blocks run at night only."""


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(p, id=name_of(p), marks=[pytest.mark.slow] * (p.stem in LONG))
        for p in PAGES
        if runnable(p)
    ],
)
def test_blocks_run(path, folder, command, monkeypatch):
    if "measured_00.txt" in path.read_text("utf-8"):
        measurements(folder)
    for options in ("SKY_OPTIONS", "SUN_OPTIONS"):  # scripts of exported cases are quick, too
        monkeypatch.setenv(options, "-ab 1 -ad 4")
    python = []
    for language, _, text in runnable(path):
        if language == "python":
            python.append(text)
            continue
        for line in text.splitlines():
            if line.startswith("sh "):
                skips.RADIANCE.skip_if_so()
                radiance.run(line.split("#")[0].split(), folder)
            if line.startswith("drcmitsuba ") and "CASE" not in line:
                for old, new in SMALLER.items():
                    line = line.replace(old, new)
                answer = command(*line.split("#")[0].split()[1:], folder=folder)
                assert (answer.code, answer.fault) == (0, ""), f"{line}\n{answer}"
    if python:
        text = "\n".join(python)
        answer = command.python(text, folder)
        assert (answer.code, answer.fault) == (0, ""), f"{text[:2000]}\n{answer}"


def measurements(folder):
    """Goniophotometer files of a sample that is looked through."""
    for incidence in (0, 20, 40):
        (file,) = measure(folder, through, [(incidence, 90)], count=400)
        file.rename(folder / f"measured_{incidence:02}.txt")
