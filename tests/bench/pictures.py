"""Sky coefficient pictures of the classroom: time and error of ours and of `rcontrib`.

    python -m tests.bench.pictures [--pixels 24] [--options "-ad 1024 -ab 7 -lw 1e-9"]

prints CPU seconds, extrapolated to 512 × 512 pixels, and RMS errors relative to the RMS of all
coefficients, of a view of the east wall, which the sky lights straight and by reflections. The
reference is a long run of ours with another seed. Equal error: time × (ratio of errors)².
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.reading import load_case
from drcmitsuba.export.primitives import GLAZING, GLAZING_FILE
from drcmitsuba.export.scene_files import scene_files
from drcmitsuba.export.sources import SKY
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.coefficient_pictures import coefficient_pictures
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.rendering.light_paths import trace
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.surfaces import surfaces_of
from tests import radiance
from tests.bench.__main__ import timed

VIEW = PictureView("perspective", (1, -0.2, 0), (0, 0, 1), (50, 50), (4.4, 4.5, 2.2))
SIZE = 512 * 512


def ours(world, size: int, sampling: Sampling, seed: int) -> np.ndarray:
    """Coefficients (pixel, bin) from light paths."""
    traced = trace(
        FacadeScenes.alone(world), VIEW, size, size, sampling=sampling,
        accuracy=Accuracy(seed=seed), subdivision=1, diameter=0.5,
    ).in_state()  # fmt: skip
    parts = [part["coefficient"].values for part in coefficient_pictures(traced)]
    return np.concatenate(parts).reshape(size * size, -1)


def by_rcontrib(surfaces, size: int, options: list[str]) -> np.ndarray:
    """Coefficients (pixel, bin) by `rcontrib`, one ray through the centre of each pixel."""
    made, d = scene_files(surfaces), VIEW.pixel_directions(size, size).reshape(-1, 3)
    rays = np.concatenate([np.tile(VIEW.position, (len(d), 1)), d], axis=1).astype(np.float32)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / GLAZING_FILE).write_text(GLAZING)
        (folder / "room.rad").write_text(made.materials + made.polygons + SKY)
        (folder / "room.oct").write_bytes(radiance.run(["oconv", "room.rad"], folder))
        command = [
            "rcontrib", "-h", "-ffa", *options, "-e", "MF:1", "-f", "reinhart.cal", "-b", "rbin",
            "-bn", "Nrbins", "-m", "skyglow", "room.oct",
        ]  # fmt: skip
        text = radiance.run(command, folder, rays.tobytes())
    return np.array(text.split(), float).reshape(len(d), -1, 3)[..., 0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pixels", type=int, default=24)
    parser.add_argument("--options", default="-ad 1024 -ab 7 -lw 1e-9")
    given = parser.parse_args()
    backend.select()
    case = load_case("classroom/existing")
    world = scene.load(case, channel=-1)
    world = replace(world, effects=replace(world.effects, solved_cells=True))
    reference = ours(world, given.pixels, Sampling(2048, paths=16, sky=64), 1)
    scale = np.sqrt((reference**2).mean())

    def error(values: np.ndarray) -> float:
        return float(np.sqrt(((values - reference) ** 2).mean()) / scale)

    shown, taken = timed(
        lambda: by_rcontrib(surfaces_of(case), given.pixels, given.options.split())
    )
    theirs, rms = taken[1] * SIZE / given.pixels**2, error(shown)
    print(f"rcontrib {given.options}: {theirs:.0f} CPU s for 512 × 512, RMS {rms:.3f}", flush=True)
    for sampling in (Sampling(8), Sampling(8, paths=16, sky=64), Sampling(32, paths=8, sky=64)):
        ours(world, 128, sampling, 0)  # compiles
        start = process_time()
        ours(world, 128, sampling, 0)
        seconds, own = process_time() - start, error(ours(world, given.pixels, sampling, 0))
        seconds *= SIZE / 128**2
        ratio = theirs / seconds * (rms / own) ** 2
        print(f"{sampling}: {seconds:.0f} CPU s, RMS {own:.3f}: {ratio:.0f}× at equal error")


if __name__ == "__main__":
    main()
