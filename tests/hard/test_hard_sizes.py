"""Many sensors, many time stamps, many triangles, and one of each: memory grows as results do.

What is measured is the peak of a process of its own, so that no other test is in it.
"""

import json
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

import drcmitsuba
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend

MIB = 2**20
SENSORS = """
import json
import sys
import numpy as np
from drcmitsuba import backend
from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.runtime.machine_memory import peak_memory
from drcmitsuba.sky.sun_models import Suns

backend.select()
angles = np.linspace(0.2, 1.2, 16)
rows = [[0, -np.cos(a), np.sin(a)] for a in angles]
suns = Suns(tuple(f"sun_{i}" for i in range(16)), np.array(rows))
sizes = []
for edge in map(int, sys.argv[1:]):
    case = Case.model_validate({
        "room": {"size": [9, 9, 3]},
        "facade": {"south": {"strips": [{"bottom": 1, "top": 2.5, "material": "open"}]}},
        "sensors": {"corner": [0.2, 0.2, 0.8], "count": [edge, edge], "spacing": 8.6 / edge},
        "accuracy": {"replicates": 2, "paths": 16, "sensor_sky_rays": 64, "cell_sky_rays": 16},
    })
    C = simulation.transport(case, "open", suns, 45.0)
    sizes.append({"peak": peak_memory(), "bytes": C.nbytes, "mean": float(C["direct"].mean()),
                 "finite": all(bool(np.isfinite(C[v]).all()) for v in C.data_vars)})
print(json.dumps(sizes))
"""
STAMPS = """
import json
import sys
import numpy as np
import drcmitsuba
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime.machine_memory import peak_memory

result = drcmitsuba.evaluate(load_case(sys.argv[1]))
E = result.illuminance
print(json.dumps({"peak": peak_memory(), "stamps": E.sizes["time"],
                  "finite": all(bool(np.isfinite(E[v]).all()) for v in E.data_vars),
                  "mean": float(E["total"].mean()), "sDA": result.metrics["sDA"]}))
"""
MESH = """
import json
import sys
import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba.scene import scene
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime.machine_memory import peak_memory
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba import backend

backend.select()
case = load_case(sys.argv[1])
points, _ = sensor_points(case)
world = scene.load(case)
n = 1 << 16
d = mi.warp.square_to_uniform_sphere(
    mi.Point2f(mi.Float(np.random.default_rng(0).random(n)), mi.Float((np.arange(n) + 0.5) / n)))
centre = mi.Point3f(2, 2.5, 1.6)
t = world.full.ray_intersect(mi.Ray3f(centre + 0.6 * d, -d)).t.numpy()
print(json.dumps({"peak": peak_memory(), "off": float(abs(0.6 - t - 0.5).max()),
                  "triangles": len(world.parts[-1].quads)}))
"""
ROOM = """
[room]
size = [4.0, 5.0, 3.0]
[facade.south]
strips = [{ bottom = 1.0, top = 2.0, material = "open" }]
[shading]
material = "shade"
[materials.shade]
type = "diffuser"
transmittance = 0.1
[accuracy]
replicates = 2
paths = 16
sensor_sky_rays = 64
cell_sky_rays = 16
cell_size = 1.0
[sensors]
corner = [1.0, 1.0, 0.8]
"""


def alone(text, *arguments):
    """A process of its own runs the text and returns JSON."""
    command = [sys.executable, "-W", "error", "-c", text, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def case_of(folder, stamps, count="[2, 2]"):
    """A small room at time stamps of its own."""
    file = folder / "stamps.csv"
    file.write_text("time\n" + "\n".join(map(str, stamps)) + "\n", encoding="utf-8")
    text = f'[period]\ntimestamps = "{file}"\n{ROOM}count = {count}\n'
    (folder / "case.toml").write_text(text, encoding="utf-8")
    return folder / "case.toml"


@pytest.mark.slow
@pytest.mark.parametrize("edges", [(40, 120), (40, 240)])
def test_many_sensors(holds, edges):
    """Up to 57,600: what is held beside the results is that of a block of 1024."""
    small, large = alone(SENSORS, *edges)
    assert small["finite"]
    assert large["finite"]
    holds("mean D = that of 1600 sensors", abs(large["mean"] / small["mean"] - 1), 0.05)
    # The results and a copy of them at the most; 32 MiB are what allocators differ by.
    grown = (large["peak"] - small["peak"] - 32 * MIB) / (large["bytes"] - small["bytes"])
    holds("growth of memory beyond 32 MiB over that of the results", max(grown, 0.0), 2.0)
    holds("peak of memory [MiB]", large["peak"] / MIB, 2048)


def ten_minutes(first, last):
    return np.arange(np.datetime64(first), np.datetime64(last), np.timedelta64(10, "m"))


@pytest.mark.parametrize(
    ("first", "last"),
    [
        ("2015-03-20T00:00", "2015-03-27T00:00"),
        pytest.param("2015-01-01T00:00", "2016-01-01T00:00", marks=pytest.mark.slow),
    ],
)
def test_many_time_stamps(holds, tmp_path, first, last):
    """A year in steps of 10 minutes has 52,560, half of them with a sun of their own."""
    stamps = ten_minutes(first, last)
    report = alone(STAMPS, case_of(tmp_path, stamps))
    assert report["stamps"] == len(stamps)
    assert report["finite"]
    assert report["sDA"]["low"] <= report["sDA"]["value"] <= report["sDA"]["high"]
    holds("peak of memory [MiB]", report["peak"] / MIB, 1024)


@pytest.mark.parametrize(
    ("stamp", "is_day"), [("2015-06-21T12:00", True), ("2015-12-21T23:00", False)]
)
def test_one_sensor_at_one_time(holds, tmp_path, stamp, is_day):
    """No spread over points or hours to take a mean or a quantile of; at night not even a sun."""
    backend.select()
    result = drcmitsuba.evaluate(load_case(case_of(tmp_path, [stamp], "[1, 1]")))
    E = result.illuminance
    values = np.array([E[v].values for v in E.data_vars if E[v].dims == ("time", "sensor")])
    assert values.shape[1:] == (1, 1)
    assert np.isfinite(values).all()
    assert (values > 0).any() == is_day
    for name in ("sDA", "ASE", "shade_closed"):
        low, value, high = (result.metrics[name][k] for k in ("low", "value", "high"))
        assert value in (0, 100)
        assert low <= value <= high
    sun, sky = (E[k].values.item() for k in ("sun_open", "sky_open"))
    off = abs(sun + sky - E["total_open"].values.item())
    holds("E = that of sky and sun [lx]", off, 1e-5 * max(1.0, sun + sky))


def write_sphere(path, rings):
    """A sphere of radius 1 as 4 · rings · (rings − 1) triangles, binary PLY."""
    polar, around = np.linspace(0, np.pi, rings + 1)[1:-1], np.arange(2 * rings) * np.pi / rings
    t, p = np.meshgrid(polar, around, indexing="ij")
    body = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    vertices = np.vstack([[0, 0, 1], body.reshape(-1, 3), [0, 0, -1]])
    k = np.arange(2 * rings)
    after, last = (k + 1) % (2 * rings), len(vertices) - 1
    bands = [1 + i * 2 * rings for i in range(rings - 1)]
    faces = [np.stack([0 * k, bands[0] + k, bands[0] + after], axis=1)]
    for a, b in pairwise(bands):
        faces += [np.stack([a + k, b + k, b + after], axis=1)]
        faces += [np.stack([a + k, b + after, a + after], axis=1)]
    faces.append(np.stack([bands[-1] + k, 0 * k + last, bands[-1] + after], axis=1))
    faces = np.concatenate(faces)
    rows = np.zeros(len(faces), [("n", "u1"), ("i", "<i4", (3,))])
    rows["n"], rows["i"] = 3, faces
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(head.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())
    return len(faces)


@pytest.mark.parametrize("rings", [100, pytest.param(501, marks=pytest.mark.slow)])
def test_mesh_of_many_triangles(holds, tmp_path, rings):
    """A million of them are 48 MB of corners: read, welded, checked and built into a scene once."""
    file = tmp_path / "ball.ply"
    count = write_sphere(file, rings)
    component = (
        f'[components.ball]\ntype = "mesh"\nfile = "{file}"\nmaterial = "silver"\nscale = 0.5\n'
        'position = [2.0, 2.5, 1.6]\n[materials.silver]\ntype = "mirror"\nreflectance = 0.9\n'
    )
    case = tmp_path / "case.toml"
    case.write_text(ROOM + "count = [2, 2]\n" + component, encoding="utf-8")
    report = alone(MESH, case)
    assert report["triangles"] == count
    # The middle of a chord lies r (1 − cos) below its arc; twice, for both axes. Float32: 2e-6 m.
    holds("rays meet it at its radius [m]", report["off"],
          2 * 0.5 * (1 - np.cos(np.pi / rings / 2)) + 4e-6)  # fmt: skip
    itself = 400 if backend.cuda_available() else 300  # the process, with a GPU's driver
    holds(f"peak of memory less {itself} MiB, over a triangle [bytes]",
          max(report["peak"] - itself * MIB, 0) / count, 1000)  # fmt: skip
