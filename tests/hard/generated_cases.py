"""Case files: valid ones of every kind, tiny so that a whole evaluation takes a moment, and damage.

A case is a tree of plain values, as TOML reads it, beside the files of `furnish`.
"""

from __future__ import annotations

import copy
import os
from itertools import pairwise
from pathlib import Path

from hypothesis import strategies as st

from drcmitsuba.case.shipped import shipped_cases, shipped_folder
from drcmitsuba.runtime.toml import read_toml
from tests.hard.mutations import damaged, mutated, places, toml

TREE = """<WindowElement><Optical><Layer><DataDefinition>
<IncidentDataStructure>{kind}</IncidentDataStructure></DataDefinition>{blocks}
</Layer></Optical></WindowElement>"""
BLOCK = """<WavelengthData><Wavelength>{wavelength}</Wavelength><WavelengthDataBlock>
<WavelengthDataDirection>{direction}</WavelengthDataDirection>
<ColumnAngleBasis>{basis}</ColumnAngleBasis><RowAngleBasis>{basis}</RowAngleBasis>
<ScatteringData>{data}</ScatteringData></WavelengthDataBlock></WavelengthData>"""


def xml(blocks, kind="TensorTree4", basis="LBNL/Klems Quarter"):
    """Text of a BSDF file; blocks are direction, text of the numbers and, if any, wavelength."""
    parts = (
        BLOCK.format(direction=d, data=t, wavelength=(*w, "Visible")[0], basis=basis)
        for d, t, *w in blocks
    )
    return TREE.format(kind=kind, blocks="\n".join(parts))


def _leaves(rank):
    """Half of the leaves of one level dark."""
    return "{" + "".join("{%g}" % (0.2 * (i % 2)) for i in range(1 << rank)) + "}"


BOX = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
BOX_FACES = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in BOX)
OBJ += "".join("f {} {} {} {}\n".format(*f) for f in BOX_FACES)
LAMELLAE = {
    "structure": {
        "kind": "lamellae", "period": 100, "width": 90, "tilt": 10.0, "turn": -20.0,
        "reflectance": 0.8, "specular": 0.5,
    }
}  # fmt: skip
PRISM = {
    "structure": {
        "kind": "prism", "n": 1.49, "period": 100,
        "polygons": [[[0, 0], [10, 0], [60, 20, 10], [10, 100], [0, 100]]],
    }
}  # fmt: skip
WEA = """place Town
latitude 46.25
longitude -6.13
time_zone -15
site_elevation 416
weather_data_file_units 1
3 21 9.5 300 150
3 21 10.5 500 200
6 21 12.5 800 150
12 21 12.5 0 90
"""

GOOD = {
    "even.xml": xml([("Transmission Front", "{0.1}"), ("Reflection Back", "{0.05}")]),
    "half.xml": xml([("Transmission Front", _leaves(4)), ("Transmission Back", _leaves(4))]),
    "rank3.xml": xml([("Transmission Back", _leaves(3))], "TensorTree3"),
    "klems.xml": xml([("Transmission Front", "0.1 " * 41**2)], "Columns"),
    "hot.xml": xml([("Transmission Front", "{0.3247}")]),  # sends out 102 %
    "black.xml": xml([("Transmission Front", "{0}"), ("Reflection Back", "{0}")]),
    "coloured.xml": xml([
        ("Transmission Front", "{0.1}"),
        ("Transmission Front", "{0.21}", "CIE-u"),
        ("Transmission Front", "{0.47}", "CIE-v"),
    ]),
    "lamellae.toml": toml(LAMELLAE),
    "prism.toml": toml(PRISM),
    "box.obj": OBJ,
    "town.wea": WEA,
    "stamps.csv": "time\n2015-03-21T10:00\n",
}  # fmt: skip
"""Files that a valid case may name."""
BAD = {
    "burning.xml": xml([("Transmission Front", "{27.855}")]),  # 8751 %
    "cut.xml": xml([("Transmission Front", "{0.1}")])[:200],
    "empty.xml": "", "empty.toml": "", "empty.obj": "", "empty.wea": "", "empty.csv": "",
    "open.obj": OBJ.rsplit("f", 1)[0],
    "flat.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "point.obj": "v 1 1 1\nf 1 1 1\n",
    "far.obj": OBJ.replace(" 1", " 1e30"),
}  # fmt: skip
"""Files that it may not, beside devices, holes and what is too large (`furnish`)."""
SUFFIXES = (".xml", ".toml", ".obj", ".ply", ".wea", ".epw", ".csv", ".tm2", ".txt")
SUFFIXES += (".rad", ".hbjson", ".stl", ".gltf", ".glb", ".pts", ".vf", ".ifc")
STRANGE = [f"{kind}{s}" for kind in ("zero", "huge", "pipe", "folder", "loop") for s in SUFFIXES]


def furnish(folder: Path) -> None:
    """Write the files that cases name: good ones, bad ones, and what is no plain file at all."""
    for name, text in (GOOD | BAD).items():
        (folder / name).write_text(text, encoding="utf-8")
    for suffix in SUFFIXES:
        (folder / f"zero{suffix}").symlink_to("/dev/zero")
        (folder / f"loop{suffix}").symlink_to(folder / f"loop{suffix}")
        (folder / f"folder{suffix}").mkdir()
        os.mkfifo(folder / f"pipe{suffix}")
        with (folder / f"huge{suffix}").open("wb") as file:
            file.truncate(10 << 30)  # a hole, no blocks


TINY = {
    "replicates": 2, "paths": 8, "cell_size": 1.0, "cell_sky_rays": 8, "sensor_sky_rays": 16,
    "sensor_sun_samples": 1, "pane_points": 4, "film_sky_samples": 4, "photons": 8,
}  # fmt: skip
MATERIALS = {
    "glass": {"type": "glazing", "transmittance": 0.65, "reflectance": 0.1},
    "opal": {"type": "diffuser", "transmittance": 0.5, "reflectance": 0.2},
    "shade": {"type": "diffuser", "transmittance": 0.1},
    "silver": {"type": "mirror", "reflectance": 0.95},
    "brushed": {"type": "mirror", "reflectance": 0.9, "roughness": 0.2, "specular": 0.8},
    "acrylic": {"type": "dielectric", "ior": 1.49, "absorption": 2.0},
}
FILMS = ("even.xml", "half.xml", "rank3.xml", "klems.xml", "hot.xml", "black.xml", "coloured.xml")
COMPONENTS = (
    {"type": "structure", "recipe": "lamellae.toml", "outer": "glass"},
    {"type": "structure", "recipe": "prism.toml", "inner": "glass", "gap": 0.01},
    {"type": "lightpipe", "centre": [1.5, 1.5], "width": 0.4, "sides": 8, "height": 0.5,
     "mirror": "silver", "bottom": "opal"},
    {"type": "duct", "centre": 1.5, "width": 0.5, "height": 0.3, "length": 1.5, "mirror": "silver"},
    {"type": "mesh", "file": "box.obj", "material": "silver", "position": [1.5, 2.5, 0.3],
     "scale": 0.2},
    {"type": "mesh", "file": "box.obj", "material": "acrylic", "position": [1.5, 2.5, 0.3],
     "scale": 0.2, "rotation": 20.0},
)  # fmt: skip
reflectances = st.one_of(
    st.sampled_from([0.0, 0.5, 1.0]), st.floats(0, 1), st.just([0.2, 0.5, 0.6])
)


def lengths(low, high):
    """Lengths of a few digits."""
    return st.floats(low, high).map(lambda v: round(v, 3))


@st.composite
def strips(draw, names, height):
    """Strips from the bottom up."""
    edges = sorted(draw(st.sets(lengths(0.0, height), min_size=2, max_size=4)))
    return [
        {"bottom": low, "top": high, "material": draw(st.sampled_from(names))}
        for low, high in pairwise(edges)
        if high - low > 0.2
    ]


@st.composite
def valid(draw):
    """A case that has a result."""
    size = [draw(lengths(2.5, 6.0)), draw(lengths(3.0, 8.0)), draw(lengths(2.2, 4.0))]
    film = draw(st.sampled_from(FILMS))
    case = {
        "name": draw(st.sampled_from(["room", "Büro \U0001f31e", "", "$[/x]$"])),
        "room": {"size": size, "rotation": draw(st.sampled_from([0.0, 30.0, -90.0, 360.0]))},
        "materials": copy.deepcopy(MATERIALS) | {"film": {"type": "bsdf", "file": film}},
        "sensors": {
            "corner": [0.2, 0.2, draw(lengths(0.01, 1.5))],
            "count": draw(st.lists(st.integers(1, 2), min_size=2, max_size=2)),
            "spacing": draw(lengths(0.01, 0.5)),
        },
        "accuracy": dict(TINY, seed=draw(st.integers(0, 1 << 30))),
    }
    for part in ("floor", "ceiling", "walls"):
        case["room"][part] = draw(reflectances)
    if draw(st.integers(0, 3)) == 0:
        case["components"] = {"part": copy.deepcopy(draw(st.sampled_from(COMPONENTS)))}
    names = ["glass", "glass", "film", "film", "opal", "open", "wall"]
    if case.get("components", {}).get("part", {}).get("type") == "structure":
        names = ["part"]
    sides = draw(st.lists(st.sampled_from(["south", "east", "north", "west"]), max_size=2))
    case["facade"] = {
        side: {
            "segments": draw(st.integers(1, 2)),
            "frame": draw(st.sampled_from([0.0, 0.1])),
            "strips": draw(strips(names, size[2])),
        }
        for side in sides
    }
    if draw(st.booleans()):
        case["shading"] = {
            "material": draw(st.sampled_from(["shade", "opal", "film"])),
            "threshold": draw(st.sampled_from([1e-3, 100.0, 1000.0, 1e6])),
            "area": draw(st.sampled_from([0.0, 0.02, 1.0])),
        }
    if draw(st.integers(0, 2)) == 0:
        case["furniture"] = [
            {
                "corner": [1.4, 1.4, 0.0], "size": [0.5, 0.5, draw(lengths(0.0, 1.0))],
                "count": [1, 1], "step": [0.0, 0.0],
            }
        ]  # fmt: skip
    case |= draw(weather_and_sky())
    case["metrics"] = {
        "sda_threshold": draw(st.sampled_from([1e-3, 300.0, 1e6])),
        "sda_fraction": draw(st.sampled_from([0.0, 0.5, 1.0])),
        "ase_hours": draw(st.sampled_from([1.0, 250.0])),
    }
    case["outside"] = {
        "ground_reflectance": draw(st.sampled_from([0.0, 0.2, 1.0])),
        "sun_diameter": draw(st.sampled_from([0.01, 0.5, 10.0])),
    }
    return case


@st.composite
def weather_and_sky(draw):
    """Period, weather, sky, sun and site that go together."""
    tables = {}
    how = draw(st.sampled_from(["stamps", "stamps", "few", "wea"]))
    if how == "wea":
        tables["weather"] = {"file": "town.wea"}
        tables["period"] = {"hours": [0, 24], "days_per_week": 7}
    elif how == "few":
        month, hour = draw(st.integers(1, 12)), draw(st.integers(0, 23))
        tables["period"] = {"months": [month], "hours": [hour, hour + 1], "days_per_week": 1}
    else:
        tables["period"] = {"timestamps": "stamps.csv"}
    if draw(st.integers(0, 3)) == 0:
        tables["site"] = {
            "latitude": draw(st.sampled_from([-90.0, 0.0, 47.0, 71.3, 90.0])),
            "longitude": draw(st.sampled_from([-180.0, 8.0, 180.0])),
            "timezone": draw(st.sampled_from([-12.0, 1.0, 5.5, 14.0])),
        }
    skies = [{}, {}, {"model": "perez", "patch_values": "centre"}]
    skies += [{"model": "perez", "subdivision": 2}]
    if how != "wea":
        skies += [{"model": "cie", "type": kind} for kind in ("overcast", "clear_with_sun", 12)]
        skies += [{"model": "cie", "type": 16, "diffuse_horizontal_illuminance": 1e4}]
        skies += [{"model": "sunshine", "probability": [0.5] * 12}]
    tables["sky"] = dict(draw(st.sampled_from(skies)))
    suns = ["true_sun"] * 5 + ["three_phase", "five_phase", "daysim"]
    tables["sun"] = {"model": draw(st.sampled_from(suns))}
    return tables


FILE_KEYS = ("file", "recipe", "timestamps")


@st.composite
def cases(draw, whole=5):
    """Text (bytes) of a case: valid in `whole` of `whole + 6`, or its tree or its text damaged."""
    how = draw(st.sampled_from(["valid"] * whole + ["tree"] * 4 + ["text", "file"]))
    case = draw(valid())
    if how == "tree":
        case = draw(mutated(case))
    elif how == "file":
        named = [p for p in places(case) if p[-1] in FILE_KEYS]
        parent = case
        path = draw(st.sampled_from(named))
        for key in path[:-1]:
            parent = parent[key]
        parent[path[-1]] = draw(st.sampled_from([*BAD, *STRANGE, *GOOD]))
    if how == "text":
        return draw(damaged(toml(case)))
    return toml(case).encode("utf-8", "replace")


@st.composite
def shipped(draw):
    """Name and text (bytes) of a shipped case made tiny, its tree or its text damaged or not."""
    how = draw(st.sampled_from(["valid"] * 3 + ["tree"] * 2 + ["text"]))
    name = draw(st.sampled_from(shipped_cases()))
    case = read_toml(shipped_folder() / f"{name}.toml", 1 << 20)
    case["accuracy"] = case.get("accuracy", {}) | TINY
    case["sensors"]["count"] = [2, 1]
    month, hour = draw(st.integers(1, 12)), draw(st.integers(6, 18))
    case["period"] = {"months": [month], "hours": [hour, hour + 1], "days_per_week": 1}
    if how == "text":
        return name, draw(damaged(toml(case)))
    if how == "tree":
        case = draw(mutated(case))
    return name, toml(case).encode("utf-8", "replace")
