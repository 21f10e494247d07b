"""`drcmitsuba case`, and cases whose building is a file of its own."""

import re
from dataclasses import replace

import pytest

from drcmitsuba.case.model_case import case_text
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.sensors import FloorSensors
from drcmitsuba.model.materials import Lambertian
from tests import ROOT

PAGE = (ROOT / "docs" / "howto" / "own_model.md").read_text(encoding="utf-8")
STUDIO = re.search(r"```text studio.rad\n(.*?)```", PAGE, re.DOTALL)[1]


@pytest.fixture
def studio(tmp_path):
    file = tmp_path / "studio.rad"
    file.write_text(STUDIO)
    return file


def test_a_model_is_drawn_and_its_case_file_is_the_model(run, studio, tmp_path):
    code, out, _ = run("case", studio, "-o", tmp_path / "out")
    assert code == 0
    assert {f.name for f in (tmp_path / "out").iterdir()} == {"scene.png", "studio.toml"}
    assert "glazing" in out
    alone, written = load_case(studio), load_case(tmp_path / "out" / "studio.toml")
    assert alone.sensors == written.sensors == FloorSensors(floors=("floor",))
    for one, other in zip(alone.building.layers, written.building.layers, strict=True):
        assert (one.name, one.role, one.material) == (other.name, other.role, other.material)
        assert (one.quads == other.quads).all()


def test_the_shade_of_a_case_file_has_a_name_of_its_own(studio):
    alone, sensors = load_case(studio).building, FloorSensors(floors=("floor",))
    assert "# [materials.shade] " in case_text(studio, studio.parent, alone, sensors)
    first, *others = alone.layers
    taken = replace(alone, layers=(replace(first, name="shade"), *others))
    text = case_text(studio, studio.parent, taken, sensors)
    assert "# [materials.sun_shade] " in text
    assert '# material = "sun_shade"' in text


def test_a_shipped_case_is_drawn(run, tmp_path):
    code, out, _ = run("case", "classroom/o3", "-o", tmp_path / "out")
    assert code == 0
    assert [f.name for f in (tmp_path / "out").iterdir()] == ["scene.png"]
    assert "scene.png" in out


def test_a_case_file_is_never_overwritten(refused, studio, tmp_path):
    (tmp_path / "studio.toml").write_text("mine")
    line = refused("case", studio, "-o", tmp_path)
    assert line.endswith("the file exists; give another folder with -o; nothing is overwritten")
    assert (tmp_path / "studio.toml").read_text() == "mine"


def case_with(studio, text):
    file = studio.with_name("case.toml")
    file.write_text(f'[sensors]\nfloors = ["floor"]\n{text}')
    return file


def test_tables_of_the_case_replace_what_the_files_say(studio):
    case = load_case(
        case_with(
            studio,
            '[model]\nfiles = ["studio.rad"]\nnorth = 12\ncontext = ["ro*f"]\n'
            "[model.reflectances]\nwalls = [0.1, 0.2, 0.3]\n"
            '[materials.glazing]\ntype = "diffuser"\ntransmittance = 0.3\n',
        )
    )
    layers = {layer.name: layer for layer in case.building.layers}
    assert layers["walls"].material == Lambertian((0.1, 0.2, 0.3))
    assert layers["roof"].role == "context"
    assert layers["glazing"].material == case.materials["glazing"]
    assert case.building.north == 12


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ('[model]\nfiles = ["none.rad"]', "model.files.0: none.rad: no such file"),
        ('[model]\nfiles = ["case.toml"]', "ending .toml; give one of .rad, .mat, .hbjson"),
        ('[model]\nfiles = ["studio.rad"]\ncontext = ["tree"]', "no surface has the material"),
        ('[model]\nfiles = ["studio.rad"]\nleave_out = ["*"]', "they hold no surface"),
        ('[model]\nfiles = ["studio.rad"]\nunits = "m"', "model.units: unknown key"),
        (
            '[model]\nfiles = ["studio.rad"]\n'
            '[materials.floor]\ntype = "mirror"\nreflectance = 0.9\n[sun]\nmodel = "adaptive"',
            "a mesh of suns would blur what components mirror",
        ),
    ],
)
def test_an_unfit_model_is_refused_in_one_line(text, complaint, refused, studio):
    file = case_with(studio, text)
    assert complaint in refused("case", file, "-o", studio.parent / "out")
    assert not (studio.parent / "out").exists()


def test_a_model_without_floors_asks_for_sensors(refused, studio):
    studio.write_text(STUDIO.replace("floor", "ground"))
    assert "no sensor grid, and no material whose name holds 'floor'" in refused("case", studio)


def test_a_leak_is_named_with_its_place(refused, studio):
    open_roof = "\n".join(line for line in STUDIO.splitlines() if "glazing" not in line)
    studio.write_text(open_roof)
    line = refused("plan", studio)
    assert "% of the rays in its rooms leave it near (" in line
