"""Variants and seasons from the command line, on a small room."""

import json

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.cli import main

ROOM = """
name = "{name}"
[period]
months = [3, 12]
hours = [10, 14]
[room]
size = [4.0, 5.0, 3.0]
[facade.south]
segments = 2
strips = [{strips}]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.fabric]
type = "diffuser"
transmittance = 0.4
reflectance = 0.4
[materials.shade]
type = "diffuser"
transmittance = 0.1
[sensors]
corner = [0.5, 0.5, 0.8]
count = [3, 4]
spacing = 1.0
[shading]
material = "shade"
{more}
"""
CLEAR = '{ bottom = 0.9, top = 2.7, material = "glass" }'
FABRIC = (
    '{ bottom = 0.9, top = 1.8, material = "glass" }, '
    '{ bottom = 1.8, top = 2.7, material = "fabric" }'
)


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, strips in (("clear", CLEAR), ("fabric", FABRIC)):
        (tmp_path / f"{name}.toml").write_text(ROOM.format(name=name, strips=strips, more=""))

    def call(*arguments):
        monkeypatch.setattr("sys.argv", ["drcmitsuba", *map(str, arguments)])
        try:
            main.main()
            code = 0
        except SystemExit as stop:
            code = stop.code or 0
        return code, *capsys.readouterr()

    return call


EAST = """[facade.east]
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
"""


GROUPS = """[groups.south]
panes = ["glass"]
facing = "south"
states = ["fabric", "shade"]
[groups.east]
panes = ["glass"]
facing = "east"
states = ["shade"]
"""

KEPT = '[output]\nilluminance = "all"\n'


def test_coefficients_of_variants_are_written_where_they_are_asked_for(run, tmp_path):
    """Without them a folder has all else, and says how to get them; E of sources is whole."""
    for name, strips in (("clear", CLEAR), ("fabric", FABRIC)):
        text = ROOM.format(name=name, strips=strips, more=EAST)
        (tmp_path / f"{name}.toml").write_text(text)
    assert run("evaluate", "clear.toml", "--variants", "fabric", "-o", "few")[0] == 0
    files = {path.name for path in (tmp_path / "few" / "fabric").iterdir()}
    assert files == {"illuminance.nc", "sky.zarr", "metrics.json", "plan.json"}
    E = xr.open_dataset(tmp_path / "few" / "fabric" / "illuminance.nc").load()
    parts = E["sky_open"] + E["sun_open"]
    np.testing.assert_allclose(parts, E["total_open"], rtol=1e-4, atol=1e-3)
    assert (E["sun_open"] > 0).any()
    assert E["facade_state"].sizes["group"] == 3  # two sides, and the fabric
    code, out, _ = run("report", "few/clear", "few/fabric")
    assert code == 0, out
    numbers = json.loads((tmp_path / "few" / "fabric" / "metrics.json").read_text())
    assert any('illuminance = "all"' in note for note in numbers["settings"]["notes"])


def test_pictures_of_variants_stand_side_by_side_unless_those_of_each_are_asked_for(run, tmp_path):
    (tmp_path / "all").mkdir()
    (tmp_path / "all" / "variants_2.png").write_bytes(b"of an earlier run with more of them")
    assert run("evaluate", "clear.toml", "--variants", "fabric", "-o", "all")[0] == 0
    assert [path.name for path in tmp_path.glob("all/*.png")] == ["variants.png"]
    assert not [*tmp_path.glob("all/*/*.png")]
    plan = json.loads((tmp_path / "all" / "fabric" / "plan.json").read_text())
    assert plan["pictures"]["on"] is False
    assert "variants.png" in plan["pictures"]["reason"]
    for choice, folders in (("all", ["clear", "fabric"]), ("off", [])):
        effects = f'[effects]\npictures = "{choice}"\n'
        for name, strips in (("clear", CLEAR), ("fabric", FABRIC)):
            text = ROOM.format(name=name, strips=strips, more=effects)
            (tmp_path / f"{name}.toml").write_text(text)
        assert run("evaluate", "clear.toml", "--variants", "fabric", "-o", f"of {choice}")[0] == 0
        assert (tmp_path / f"of {choice}" / "variants.png").exists() is (choice == "all")
        drawn = tmp_path.glob(f"of {choice}/*/monthly.png")
        assert sorted(path.parent.name for path in drawn) == folders


@pytest.mark.parametrize(
    "more",
    [
        pytest.param("", id="one side"),
        pytest.param(EAST, id="two sides", marks=pytest.mark.slow),
        pytest.param(EAST + GROUPS, id="groups of panes", marks=pytest.mark.slow),
    ],
)
def test_variants_are_what_each_is_alone(run, tmp_path, same, more):
    for name, strips in (("clear", CLEAR), ("fabric", FABRIC)):
        text = ROOM.format(name=name, strips=strips, more=more + KEPT)
        (tmp_path / f"{name}.toml").write_text(text)
    code, out, err = run("evaluate", "clear.toml", "--variants", "fabric", "-o", "all")
    assert (code, err) == (0, "")
    assert "clear" in out
    assert "fabric" in out
    for name in ("clear", "fabric"):
        assert run("evaluate", f"{name}.toml", "-o", name)[0] == 0
        ours, alone = tmp_path / "all" / name, tmp_path / name
        a, b = (xr.open_dataset(folder / "illuminance.nc").load() for folder in (ours, alone))
        assert a["total"].shape == b["total"].shape
        error = np.hypot(a["total_se"], b["total_se"])
        assert (abs(a["total"] - b["total"]) > 6 * error + 0.01 * b["total"]).mean() < 0.01
        # A sensor at a pane's edge, of 2160 sensors and hours, is in the sun by half of its disk.
        in_sun = [(E["direct_sun"] >= 1000).values for E in (a, b)]
        assert in_sun[1].mean() > 0.05
        assert (in_sun[0] != in_sun[1]).sum() <= 2
        C = [xr.open_zarr(f / "coefficients.zarr")["replicates"] for f in (ours, alone)]
        states = [state for state in C[0]["state"].values if state in C[1]["state"].values]
        assert "open" in states
        assert len(states) > 1
        for state in states:
            sky = [c.sel(state=state).isel(bin=slice(146)).sum("bin").values for c in C]
            same(sky[0], other=sky[1], within=0.008)
        metrics = [json.loads((f / "metrics.json").read_text()) for f in (ours, alone)]
        assert set(metrics[0]) == set(metrics[1])
        assert {p.name for p in (tmp_path / "all" / name).iterdir()} >= {
            "coefficients.zarr", "sky.zarr", "plan.json",
        }  # fmt: skip


@pytest.mark.parametrize(
    ("names", "more", "said"),
    [
        ("nothing", "", "no such file"),
        ("fabric,fabric", "", "once"),
        ("../fabric", "", "beside the case"),
        ("", "", "beside the case"),
        ("fabric", "[outside]\nground_reflectance = 0.3", "outside"),
    ],
)
def test_bad_variants(run, tmp_path, names, more, said):
    text = ROOM.format(name="clear", strips=CLEAR, more=more)
    (tmp_path / "clear.toml").write_text(text)
    if "outside" not in said:
        text = ROOM.format(name="fabric", strips=FABRIC, more=more)
        (tmp_path / "fabric.toml").write_text(text)
    code, _, err = run("evaluate", "clear.toml", "--variants", names, "-o", "all")
    assert code == 2
    assert said in err
    assert err.count("\n") == 1
    assert not list((tmp_path / "all").rglob("*.json"))


def test_a_shade_and_groups_that_lack_it_may_be_compared(run, tmp_path):
    """The openings of one variant close by the shade, those of the other by a group, or never."""
    shaded = ROOM.format(name="a", strips=CLEAR, more=EAST)
    group = '[groups.east]\npanes = ["glass"]\nfacing = "east"\nstates = ["fabric"]\n'
    grouped = shaded.replace('name = "a"', 'name = "b"') + group
    for name, text in (("a", shaded), ("b", grouped)):
        (tmp_path / f"{name}.toml").write_text(text.replace("[3, 12]", "[3]"))
    code, _, err = run("evaluate", "a.toml", "--variants", "b", "-o", "both")
    assert (code, err) == (0, "")
    shares = [
        json.loads((tmp_path / "both" / name / "metrics.json").read_text())["groups"]
        for name in ("a", "b")
    ]
    assert set(shares[0]) == {"south", "east"}
    assert set(shares[1]) == {"east"}


@pytest.mark.parametrize("shade", ["shade", "fabric"])
def test_season(run, tmp_path, shade):
    """Also where the shade is of a material that stands in the façade for good."""
    case = tmp_path / "fabric.toml"
    case.write_text(case.read_text().replace('material = "shade"', f'material = "{shade}"'))
    code, out, err = run("season", case, "-o", "season")
    assert (code, err) == (0, "")
    assert (tmp_path / "season" / "season.png").stat().st_size > 10_000
    told = json.loads((tmp_path / "season" / "season.json").read_text())
    assert any("no year" in note for note in told["notes"])
    assert f"note: {told['notes'][0]}" in out
    msda = told["msDA"]
    for name in ("design", "clear", "opening", "relative", "gain"):
        assert [m is not None for m in msda[name]] == [m in (3, 12) for m in range(1, 13)], name
    for month in (2, 11):
        values = {n: msda[n][month]["value"] for n in ("design", "clear", "opening")}
        assert values["opening"] >= max(values["design"], values["clear"])
        assert msda["gain"][month] == pytest.approx(values["design"] - values["clear"])
        assert msda["relative"][month] == pytest.approx(100 * values["design"] / values["opening"])
    assert "of the opening" in out.replace("\n", " ")


def test_season_of_a_case_with_groups_in_two_sides(run, tmp_path):
    """The clear façade keeps the states of its groups, and the film's side has none."""
    east = '[facade.east]\nstrips = [{ bottom = 0.9, top = 2.7, material = "fabric" }]\n'
    groups = '[groups.south]\npanes = ["glass"]\nstates = ["fabric"]\n'
    text = ROOM.format(name="corner", strips=CLEAR, more=east + groups)
    (tmp_path / "corner.toml").write_text(text)
    assert run("season", "corner.toml", "-o", "corner")[0] == 0
    msda = json.loads((tmp_path / "corner" / "season.json").read_text())["msDA"]
    design, clear, opening = (msda[name][2]["value"] for name in ("design", "clear", "opening"))
    assert design <= opening
    assert clear <= opening


def test_season_without_glazing(run, tmp_path):
    text = ROOM.format(name="x", strips=CLEAR.replace("glass", "fabric"), more="")
    text = text.replace('type = "glazing"', 'type = "diffuser"')
    (tmp_path / "x.toml").write_text(text)
    code, _, err = run("season", "x.toml")
    assert code == 2
    assert "no glazing" in err
