"""`drcmitsuba optimise` on a small room."""

import json

import pandas as pd
import pytest

CASE = """
name = "small room"
[period]
months = [3]
[room]
size = [8.8, 9.0, 3.6]
[facade.south]
segments = 3
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.film]
type = "diffuser"
transmittance = 0.5
[materials.shade]
type = "diffuser"
transmittance = 0.1
[sensors]
corner = [0.5, 0.5, 0.8]
count = [4, 4]
spacing = 1.5
[shading]
material = "shade"
[metrics]
ase_hours = 10.0
[accuracy]
replicates = 2
paths = 16
[design]
film = "film"
rows = 3
starts = 1
sharpness = [8.0, 16.0]
iterations = 8
pareto = 3
"""
SHORT = CASE.replace("pareto = 3", "pareto = 0").replace("[8.0, 16.0]", "[8.0]")
"""A search that may end before it finds the best: what is compared holds for any façade."""


@pytest.fixture
def case(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(CASE)
    return file


FILES = {
    "optimum.json", "history.csv", "pareto.csv", "pareto.png", "facade.png", "search.png",
    "fresh_metrics.json",
}  # fmt: skip


def test_a_search_leaves_its_files_and_prints_its_optimum(run, case, tmp_path):
    case.write_text(CASE.replace("[accuracy]", '[accuracy]\ntarget = "90 points"'))
    code, out, _ = run("optimise", case, "-o", tmp_path / "d")
    assert code == 0
    assert 'note: accuracy.target: "90 points": light that façades share has no rounds' in out
    assert {f.name for f in (tmp_path / "d").iterdir()} == FILES
    optimum = json.loads((tmp_path / "d" / "optimum.json").read_text())
    assert optimum["feasible"]
    assert optimum["ASE"] <= 10
    assert f"{optimum['evaluations']} façades by all hours" in out
    fresh = json.loads((tmp_path / "d" / "fresh_metrics.json").read_text())
    assert fresh["sDA"]["low"] <= fresh["sDA"]["value"] <= fresh["sDA"]["high"]
    assert fresh["sDA"]["value"] == pytest.approx(
        optimum["sDA"], abs=7
    )  # of 16 points, 2 replicates
    assert fresh["ASE"]["value"] == pytest.approx(optimum["ASE"], abs=13)
    assert f"{fresh['sDA']['value']:.1f} (" in out
    front = pd.read_csv(tmp_path / "d" / "pareto.csv")
    assert front.ASE.is_monotonic_increasing
    assert front.value.is_monotonic_increasing
    strips = fresh["settings"]["facade"]["south"]["strips"]
    film = sum(s["top"] - s["bottom"] for s in strips if s["material"] == "film")
    assert film * 8.8 == pytest.approx(optimum["film_m2"], abs=0.05)


WEST = """
[facade.west]
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
"""
TWO_SIDES = SHORT.replace("[design]", '[design]\nside = "south"') + WEST
BRIGHT = "[metrics]\nsda_threshold = 3000.0"


@pytest.mark.slow
def test_windows_of_other_sides_stay_and_light_the_room(run, case, tmp_path):
    case.write_text(SHORT.replace("[metrics]", BRIGHT))
    assert run("optimise", case, "-o", tmp_path / "alone")[0] == 0
    two = TWO_SIDES.replace("[shading]", '[shading]\ngroups = "together"')
    case.write_text(two.replace("[metrics]", BRIGHT))
    assert run("optimise", case, "-o", tmp_path / "both")[0] == 0
    alone, both = (
        json.loads((tmp_path / k / "optimum.json").read_text()) for k in ("alone", "both")
    )
    fresh = json.loads((tmp_path / "both" / "fresh_metrics.json").read_text())
    assert both["sDA"] > alone["sDA"]
    point = 100 / 16
    assert fresh["sDA"]["low"] - point <= both["sDA"] <= fresh["sDA"]["high"] + point


@pytest.mark.slow
@pytest.mark.parametrize("drawn", ["glass", "film"])
def test_shades_may_close_side_by_side(run, case, tmp_path, drawn):
    """Also where the searched side has no clear pane yet, which the search closes by itself."""
    text = TWO_SIDES.replace('material = "glass" }]', f'material = "{drawn}" }}]', 1)
    case.write_text(text.replace("[design]", '[design]\nclear = "glass"'))
    code, _, err = run("optimise", case, "-o", tmp_path / "d")
    assert (code, err) == (0, "")
    best, fresh = (
        json.loads((tmp_path / "d" / f"{k}.json").read_text()) for k in ("optimum", "fresh_metrics")
    )
    point = 100 / 16
    assert fresh["sDA"]["low"] - point <= best["sDA"] <= fresh["sDA"]["high"] + point


def test_turned_transmittances_are_simulated_afresh(run, case, tmp_path):
    case.write_text(SHORT + 'shade_vlt = [0.05, 0.2]\nobjective = "worst month"\n')
    code, out, _ = run("optimise", case, "-o", tmp_path / "d")
    assert code == 0
    assert "shade_vlt" in out
    optimum = json.loads((tmp_path / "d" / "optimum.json").read_text())
    fresh = json.loads((tmp_path / "d" / "fresh_metrics.json").read_text())
    row = next(line for line in out.splitlines() if "msDA of the worst month" in line)
    assert f"{optimum['worst_msDA']:.1f} %" in row
    assert f"{fresh['msDA'][2]['value']:.1f} (" in row
    materials = fresh["settings"]["materials"]
    assert materials["shade"]["transmittance"] == pytest.approx(optimum["shade_vlt"])
    assert 0.05 <= optimum["shade_vlt"] <= 0.2
    assert materials["glass"]["transmittance"] == 0.65


def test_a_search_knows_the_façade_as_it_is_and_says_what_does_not_stay(run, case, tmp_path):
    strips = [
        {"bottom": 0.9, "top": 1.5, "material": "glass"},
        {"bottom": 1.5, "top": 2.1, "material": "film"},
        {"bottom": 2.1, "top": 2.4, "material": "milk"},
        {"bottom": 2.8, "top": 2.9, "material": "glass"},
    ]
    strips = ", ".join(
        "{" + ", ".join(f"{k} = {json.dumps(v)}" for k, v in s.items()) + "}" for s in strips
    )
    drawn = '{ bottom = 0.9, top = 2.7, material = "glass" }'
    milk = '[materials.milk]\ntype = "diffuser"\ntransmittance = 0.3\n[materials.shade]'
    text = SHORT.replace(drawn, strips).replace("[materials.shade]", milk)
    case.write_text(text + 'parameters = "strips"\nband = [0.9, 2.7]\nsegments = 1\n')
    code, out, _ = run("optimise", case, "-o", tmp_path / "d")
    assert code == 0
    assert '"milk", 2.1 to 2.4 m, does not stay: tiles are wall, glass or film' in out
    assert '"glass", 2.8 to 2.9 m, does not stay: beyond the band from 0.9 to 2.7 m' in out
    known = pd.read_csv(tmp_path / "d" / "history.csv").iloc[0]
    shares = [known[f"{key}_{k}"] for key in ("window", "film") for k in range(3)]
    assert shares == pytest.approx([1, 1, 0, 0, 1, 0], abs=1e-3)


def test_a_free_material_of_a_component_is_refused_in_one_line(run, case, tmp_path):
    pipe = """
    [components.pipe]
    type = "lightpipe"
    centre = [2.5, 2.5]
    width = 0.5
    height = 0.6
    mirror = "silver"
    top = "glass"
    [materials.silver]
    type = "mirror"
    reflectance = 0.95
    """
    case.write_text(SHORT + "glazing_transmittance = [0.3, 0.7]\n" + pipe)
    code, _, err = run("optimise", case, "-o", tmp_path / "d")
    assert code == 2
    line = (
        'components."pipe".top is "glass", too; give it a material of its own, which may be alike'
    )
    assert err.strip().endswith(f"design.glazing_transmittance: {line}")


def test_a_case_without_design_ends_with_one_line(run, case, tmp_path):
    case.write_text(CASE[: CASE.index("[design]")])
    code, _, err = run("optimise", case, "-o", tmp_path / "d")
    assert code == 2
    assert err.strip().endswith("design: no such table; add [design] with film = \"…\", a material "
                                "of [materials]")  # fmt: skip
    assert not (tmp_path / "d").exists()
