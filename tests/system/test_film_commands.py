"""Films from the command line: checked, measured, made, and part of a year."""

import json

import numpy as np
import pytest

from drcmitsuba import bsdf, evaluate, load_case
from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.scene.materials import film, lets_through

PRISM = shipped_folder() / "films" / "prism.xml"
CASE = """
[period]
months = [3]
[room]
size = [4.0, 5.0, 3.0]
[facade.south]
strips = [
    { bottom = 0.9, top = 1.8, material = "glass" },
    { bottom = 1.8, top = 2.7, material = "film" },
]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.film]
type = "bsdf"
file = "film.xml"
[sensors]
corner = [0.5, 0.5, 0.8]
count = [3, 3]
spacing = 0.6
[accuracy]
replicates = 2
paths = 16
cell_size = 0.6
"""
EVEN = """<WindowElement><Optical><Layer><DataDefinition>
<IncidentDataStructure>TensorTree4</IncidentDataStructure></DataDefinition>
<WavelengthData><Wavelength>Visible</Wavelength><WavelengthDataBlock>
<WavelengthDataDirection>Transmission Front</WavelengthDataDirection>
<ScatteringData>{{ {value} }}</ScatteringData></WavelengthDataBlock></WavelengthData>
</Layer></Optical></WindowElement>"""
SLATS = """
name = "slats"
[structure]
kind = "lamellae"
period = 10.0
width = 10.0
tilt = 30.0
reflectance = 0.6
"""


@pytest.fixture
def case(tmp_path):
    (tmp_path / "film.xml").write_text(EVEN.format(value=0.4 / np.pi))
    path = tmp_path / "case.toml"
    path.write_text(CASE)
    return path


def test_the_shipped_film_is_checked_and_shown(run, tmp_path):
    code, out, err = run("bsdf", PRISM, "-o", tmp_path / "out", "--sun", 40, 20)
    assert (code, err) == (0, "")
    assert "tensor tree" in out
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {"bsdf.json", "lobes.png", "section.png", "curves.png"}
    report = json.loads((tmp_path / "out" / "bsdf.json").read_text())
    up = {s["elevation"]: s["upward"] for s in report["sunlight"]}
    assert min(up[e] for e in (30, 40, 50, 60)) > 0.9  # what the film is for
    assert report["verdict"] == "ok"
    code, out, _ = run("bsdf", PRISM, "--json")
    assert json.loads(out) == report


def test_the_shipped_film_has_no_view_and_keeps_energy():
    prism = film(PRISM)
    assert not prism.stands_out
    assert prism.largest_albedo < 1
    assert bsdf.read(PRISM).components.keys() == {"tb", "tf", "rb", "rf"}


def test_a_recipe_becomes_a_film_that_reads_back(run, tmp_path):
    recipe, made = tmp_path / "slats.toml", tmp_path / "slats.xml"
    recipe.write_text(SLATS)
    code, out, err = run("goniophotometer", recipe, "-o", made, "--depth", 2, "--samples", 64)
    assert (code, err) == (0, "")
    assert "TensorTree4" in out
    code, out, _ = run("bsdf", made)
    assert code == 0
    assert "slats" in out


def test_measurements_become_a_film(run, tmp_path):
    for incidence in (0, 30, 60):
        lines = ['#sample_name "opal"', "#format: theta phi BTDF", f"#incident_angle {incidence} 0"]
        for theta in range(93, 180, 6):
            lines += [f"{theta} {phi} 0.1" for phi in range(0, 360, 15)]
        (tmp_path / f"opal{incidence}.txt").write_text("\n".join(lines) + "\n")
    files = sorted(tmp_path.glob("*.txt"))
    code, out, err = run("bsdf", *files, "-o", tmp_path / "opal.xml", "--depth", 3)
    assert (code, err) == (0, "")
    assert "TensorTree3" in out
    made = bsdf.read(tmp_path / "opal.xml")
    t, _ = made.hemispherical(np.array([[0, 0, 1.0], [0.5, 0, 0.8]]))
    assert t == pytest.approx(0.1 * np.pi, rel=0.03)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("bsdf", "none.xml"), "none.xml: file: No such file or directory; name a BSDF file"),
        (("bsdf", "a.txt"), "command line: -o: nothing; name the film: -o film.xml"),
        (("bsdf", PRISM, "--sun", 95, 0),
         "command line: --sun: 95 0; elevation 0 … 90, azimuth −90 … 90 deg"),
        (("goniophotometer", "films/prism", "-o", "film.toml"),
         "film.toml: -o: no name of an XML file; name the film: -o film.xml"),
        (("goniophotometer", "films/../films/prism", "-o", "film.xml"),
         "films/../films/prism: file: No such file or directory; check its path and rights"),
    ],
)  # fmt: skip
def test_wrong_use_gives_one_line(refused, tmp_path, monkeypatch, arguments, line):
    monkeypatch.chdir(tmp_path)
    assert refused(*arguments) == line
    assert not list(tmp_path.iterdir())


# Films in a case


def test_a_year_with_a_film(case):
    result = evaluate(load_case(case))
    assert result.plan["films"]["on"]
    assert not result.plan["straight_through"]["on"]
    assert "does not stand out" in result.plan["straight_through"]["reason"]
    # What the film scatters is direct, and no direct sun.
    C = result.coefficients.sel(state="open")
    assert (C.direct > C.straight).any()


def test_an_even_film_is_a_diffuser(case, same):
    """The same pane by the film's way and by that of diffusers."""
    text = case.read_text().replace("replicates = 2", "replicates = 8")
    case.write_text(text)
    by_film = evaluate(load_case(case)).coefficients.sel(state="open")
    other = case.with_name("other.toml")
    diffuser = '"diffuser"\ntransmittance = 0.4'
    other.write_text(text.replace('"bsdf"\nfile = "film.xml"', diffuser))
    as_diffuser = evaluate(load_case(other)).coefficients.sel(state="open")
    for name in ("direct", "interreflected"):
        a, b = (c[name].values.sum(axis=1) for c in (by_film, as_diffuser))
        assert a.sum() == pytest.approx(b.sum(), rel=0.02)
    a, b = (c["replicates"].sum("bin").transpose("replicate", ...) for c in (by_film, as_diffuser))
    same(a.values, other=b.values, within=0.01)
    # Threads add up in any order: the last digit may differ.
    np.testing.assert_allclose(by_film.straight, as_diffuser.straight, rtol=1e-5)


def test_a_film_that_is_not_there_is_refused(refused, case):
    (case.parent / "film.xml").unlink()
    message = "materials.film.file: film.xml: no such file; give its path relative to the case file"
    assert message in refused("evaluate", case, "-o", case.parent / "out")


def test_a_film_that_makes_light_is_refused_before_the_work(refused, case):
    (case.parent / "film.xml").write_text(EVEN.format(value=0.5))
    line = refused("evaluate", case, "-o", case.parent / "out")
    assert "film.xml: energy: sends out 157 % of the light" in line
    assert not (case.parent / "out").exists()


def test_a_film_that_makes_a_little_light_is_scaled_and_noted(case):
    (case.parent / "film.xml").write_text(EVEN.format(value=1.02 / np.pi))
    notes = evaluate(load_case(case)).metrics["settings"]["notes"]
    assert any("sends out up to 102.0 % of the light; scaled down" in n for n in notes)


def test_a_film_can_be_the_shade(case):
    text = case.read_text() + '[shading]\nmaterial = "film"\nthreshold = 1.0\narea = 0.01\n'
    case.write_text(text)
    result = evaluate(load_case(case))
    assert result.plan["shaded_state"]["on"]
    shaded = result.coefficients.sel(state="shaded")
    assert float(shaded.straight.max()) == 0
    assert float(shaded.direct.max()) > 0


def test_the_view_can_be_switched(case):
    material = load_case(case).materials["film"]
    assert not lets_through(material)
    n = 8
    s = np.indices((n,) * 4).reshape(4, -1)
    straight = (s[0] == s[2]) & (s[1] == s[3])
    values = np.where(straight, 0.6 * n * n / np.pi, 0)
    (case.parent / "film.xml").write_text(EVEN.format(value=" ".join(f"{v:.6g}" for v in values)))
    clear = load_case(case).materials["film"]
    assert lets_through(clear)
    assert not lets_through(clear.model_copy(update={"straight_through": "off"}))
