"""Seconds and memory of a building of many rooms: python -m tests.bench.slab [--rooms 10 50 200]

Rooms of 4 m × 5 m × 3 m stand side by side and one above the other, 20 high at most; each has a
window to the south and 25 sensors, and shares its walls and slabs with its neighbours. Every number
of rooms is evaluated for a year in a process of its own, as `evaluate --memory 3GiB` does, between
two times 32 M bare closest hits in the same scene.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import drjit as dr
import numpy as np
import shapely

from drcmitsuba.annual.result import evaluate_within
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import GlazingMaterial, Lambertian
from drcmitsuba.model.model import Layer, Model, SensorGrid, role_of
from drcmitsuba.model.polygon import quads_of
from drcmitsuba.model.space import Space, SpaceFloor
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from tests.bench.stages import bare

HIGH = 20
"""Largest number of storeys."""
WIDE, DEEP, TALL = 4.0, 5.0, 3.0
"""Size of a room [m]."""
WINDOW = np.array([[0.8, 0, 0.9], [3.2, 0, 0.9], [3.2, 0, 2.5], [0.8, 0, 2.5]])
PERIOD = {"calendar": "EvalDRC"}
MEMORY = 3 << 30
"""Memory that the arrays may take [bytes]."""


def building(rooms: int, folder: Path) -> Case:
    """Case of a slab of rooms; a file in the folder stands for what it was read from."""
    file = folder / "slab.rad"
    file.write_text(f"# {rooms} rooms\n")
    high = min(HIGH, rooms)
    across = -(-rooms // high)
    at = [(i, k) for i in range(across) for k in range(high)][:rooms]
    materials = {
        "wall": Lambertian(0.5), "slab": Lambertian(0.2, 0.7), "roof": Lambertian(0.7),
        "glass": GlazingMaterial(type="glazing", transmittance=0.7),
    }  # fmt: skip
    faces: dict[str, dict[tuple, np.ndarray]] = {name: {} for name in materials}

    def add(name: str, corners: list, *holes: np.ndarray) -> None:
        ring = np.array(corners, float)
        faces[name].setdefault(tuple(ring.mean(axis=0).round(3)), quads_of(ring, holes))

    grids, spaces = [], []
    for i, k in at:
        x, z = i * WIDE, k * TALL
        u, w, y = x + WIDE, z + TALL, DEEP
        add("slab", [[x, 0, z], [u, 0, z], [u, y, z], [x, y, z]])
        add(
            "roof" if (i, k + 1) not in at else "slab", [[x, 0, w], [u, 0, w], [u, y, w], [x, y, w]]
        )
        add("wall", [[x, 0, z], [x, y, z], [x, y, w], [x, 0, w]])
        add("wall", [[u, 0, z], [u, y, z], [u, y, w], [u, 0, w]])
        add("wall", [[x, y, z], [u, y, z], [u, y, w], [x, y, w]])
        hole = WINDOW + [x, 0, z]
        add("wall", [[x, 0, z], [u, 0, z], [u, 0, w], [x, 0, w]], hole)
        add("glass", hole.tolist())
        line = (np.arange(5) + 0.5) / 5
        points = [[x + WIDE * a, DEEP * b, z + 0.8] for b in line for a in line]
        name = f"room {i + 1}.{k + 1}"
        grids.append(SensorGrid(name, np.array(points), np.tile([0.0, 0, 1], (25, 1))))
        floor = SpaceFloor(z, shapely.box(x, 0, u, y))
        spaces.append(Space(name, (floor,), w, storey=f"level {k + 1}"))
    layers = []
    for name, own in faces.items():
        if own:
            cut = list(own.values())
            number = np.repeat(np.arange(len(cut)), [len(q) for q in cut])
            role, quads = role_of(materials[name]), np.concatenate(cut)
            layers.append(Layer(name, materials[name], role, quads, number, (name,)))
    tables = {"name": "slab", "model": {"files": [str(file)]}, "sensors": {"grids": ["*"]}}
    case = Case.model_validate({**tables, "period": PERIOD})
    case.materials["glass"] = materials["glass"]
    case._building = Model(tuple(layers), tuple(grids), spaces=tuple(spaces))
    return case


def measure(rooms: int) -> None:
    """Evaluate a slab of rooms and print a row."""
    backend.select()
    folder = Path(tempfile.mkdtemp())
    evaluate_within(building(40, folder), memory=MEMORY)  # kernels
    case = building(rooms, folder)
    world = scene.load(case)
    bare(world)
    rays = bare(world)
    dr.flush_malloc_cache()
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    start = perf_counter()
    result = evaluate_within(case, memory=MEMORY)
    seconds = perf_counter() - start
    status = Path("/proc/self/status").read_text().split()
    peak = int(status[status.index("VmHWM:") + 1]) / 2**20
    dr.flush_malloc_cache()
    rays = (rays + bare(world)) / 2
    print(f"| {rooms} | {25 * rooms} | {seconds:.1f} | {seconds / rays:.1f} | {peak:.2f} | "
          f"{result.metrics['building']['sDA']['value']:.1f} |", flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, nargs="+", default=[10, 50, 200])
    parser.add_argument("--alone", action="store_true", help="in this process, one number of rooms")
    options = parser.parse_args()
    if options.alone:
        measure(options.rooms[0])
        return
    print("| rooms | sensors | seconds | / bare | peak GiB | sDA % |\n|---|---|---|---|---|---|")
    for rooms in options.rooms:
        command = [sys.executable, "-m", "tests.bench.slab", "--alone", "--rooms", str(rooms)]
        subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
