"""The sky of a building of many rooms by Radiance: python -m tests.bench.slab_radiance [--rooms 10]

Two-phase method: coefficients of ground and Tregenza patches by `rcontrib` with the options of
`export --radiance`, here with fewer rays, for the sensors of `tests.bench.slab`; beside ours of the
same rooms in the same run. Radiance's time grows with the sensors, and its error is brought to ours
by the square of the ratio of errors. The errors are those of the illuminance by an even sky, root
mean square over the sensors, from independent repeats (Radiance) and replicates (ours). Suns take
Radiance as long again for every hundred of them; ours are part of `tests.bench.slab`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

from drcmitsuba.annual import simulation
from drcmitsuba.export.radiance import save_radiance
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.sky.daylight import daylight
from tests import radiance
from tests.bench.slab import building
from tests.bench.stages import bare
from tests.unit.export.radiance_text import matrix

REPEATS = 6
OPTIONS = "-ab 12 -lr -12 -lw 1e-5 -ad 512"


def by_radiance(folder: Path) -> tuple[float, np.ndarray]:
    """Seconds of one run for all sensors, and the illuminance by each repeat (repeat, sensor)."""
    root = radiance.home()
    assert root is not None, "set up Radiance, see tests/validation/README.md"
    sensors = (folder / "sensors.pts").read_text()
    count = len(sensors.splitlines())
    (folder / "sensors.pts").write_text(REPEATS * sensors)
    paths = {"PATH": os.pathsep.join([str(root / "bin"), os.environ["PATH"]]),
             "RAYPATH": f".:{root / 'lib'}"}  # fmt: skip
    run = (
        "oconv materials.rad scene.rad sky.rad > sky.oct && "
        f"rcontrib -n {os.cpu_count()} -I+ -faf -y {REPEATS * count} {OPTIONS} -e MF:1 "
        "-f reinhart.cal -b rbin -bn Nrbins -m skyglow sky.oct < sensors.pts > C_sky.mtx"
    )
    start = perf_counter()
    subprocess.run(["sh", "-c", run], cwd=folder, env=paths, check=True)
    seconds = (perf_counter() - start) / REPEATS
    C = matrix(folder / "C_sky.mtx")[..., 0]
    return seconds, C.reshape(REPEATS, count, -1).sum(axis=2)


def relative_error(E: np.ndarray, of_mean: bool) -> float:
    """Root mean square over the sensors of the standard error [–] of one row of E, or its mean."""
    error = E.std(axis=0, ddof=1) / (np.sqrt(len(E)) if of_mean else 1)
    return float(np.sqrt(np.mean((error / E.mean(axis=0)) ** 2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, default=10)
    rooms = parser.parse_args().rooms
    backend.select()
    folder = Path(tempfile.mkdtemp())
    case = building(rooms, folder)
    save_radiance(case, folder / "exported", "open")
    theirs, E = by_radiance(folder / "exported")
    error = relative_error(E, of_mean=False)
    world = scene.load(case)
    bare(world)
    rays, light = bare(world), daylight(case)
    effort = []
    for _ in range(2):  # the first run compiles kernels
        start = perf_counter()
        none = light.suns.where(np.zeros(len(light.suns.labels), bool))
        C = simulation.transport(case, "open", none, light.sky.attrs["latitude"])
        effort.append(perf_counter() - start)
    ours = relative_error(C["replicates"].values.sum(axis=2), of_mean=True)
    equal = theirs * (error / ours) ** 2
    print("| | seconds | error of E | seconds at our error | / bare |\n|---|---|---|---|---|")
    print(f"| Radiance, {rooms} rooms, sky | {theirs:.1f} | {error:.1%} | {equal:.0f} | "
          f"{equal / rays:.0f} |")  # fmt: skip
    print(f"| ours, {rooms} rooms, sky | {effort[-1]:.1f} | {ours:.1%} | {effort[-1]:.1f} | "
          f"{effort[-1] / rays:.1f} |")  # fmt: skip
    print(f"\n{rays:.2f} s for 32 M bare closest hits; mean E of Radiance over ours "
          f"{E.mean() / C['replicates'].values.sum(axis=2).mean():.4f}")  # fmt: skip


if __name__ == "__main__":
    main()
