"""Light of all seeds beside that of the path tracer, and how its intervals hold."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import disk_solid_angle
from scipy.stats import t as student

import drcmitsuba
from drcmitsuba.case.case import Case
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.glare_year.eyes import eyes
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import origin, rotation
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from tests.validation.calibration.image_mirror import image_mirror
from tests.validation.calibration.rooms import WIDE, Room

CHUNKS = 16
"""Number of independent runs of the path tracer."""
AT_EYES, SKY_AT_EYES = 1 << 15, 1 << 18
"""Number of paths from an eye in each run of the path tracer, and of those to the sky alone, which
cost little and give most of the light: the tracer's own error is smaller than ours."""
RESAMPLED = 100
"""Number of draws from the runs of the path tracer, for its part in the error of a coverage."""
FAINT = 1e-3
EFFECTS = EnabledEffects(solved_cells=True, pane_to_pane=False)
PATCHES, BINS = slice(1, 146), 146
HOURS = [f"2015-{day}T{hour:02d}:30" for day in ("01-20", "03-21", "06-21", "10-15")
         for hour in (9, 12, 14)]  # fmt: skip


@dataclass(frozen=True)
class Coverage:
    """How intervals of a kind of light hold in a quarter of the entries."""

    light: str
    """"sky", "suns" or "glare"."""
    quarter: int
    """1 for the darkest."""
    bias: float
    """Mean of the light of all seeds over the truth, less 1."""
    bias_error: float
    """Standard error of the bias."""
    covered: float
    """Share of entries whose interval holds the truth."""
    covered_error: float
    """Standard error of that share: over the seeds, since entries of one seed share their noise,
    and over the runs of the path tracer, whose noise all seeds share."""
    stated: float
    """Median standard error over the truth."""


def by_paths(
    room: Room, suns: Suns, points: np.ndarray, normals: np.ndarray, spp: int
) -> np.ndarray:
    """Coefficients by the path tracer [sr], (chunk, part: direct or not, channel, sensor, bin)."""
    if room.images is None:
        return _of_scene(room.case, suns, points, normals, spp)
    # Disks so narrow are not found in the mirror; their images are.
    narrow = replace(suns, diameter=0.01)
    C = _of_scene(room.case, narrow, points, normals, spp)
    C[..., BINS:] *= disk_solid_angle(suns.diameter) / disk_solid_angle(narrow.diameter)
    case, mirror = room.images
    mirrored = replace(suns, directions=suns.directions * [1, -1, 1])
    there = points + (origin(room.case) - origin(case)) @ rotation(case).T
    C[..., BINS:] += _of_scene(case, mirrored, there, normals, spp, mirror)[..., BINS:]
    return C


def _of_scene(
    case: Case, suns: Suns | None, points: np.ndarray, normals: np.ndarray, spp: int,
    mirror: str = "",
) -> np.ndarray:  # fmt: skip
    """Coefficients of a case, in which suns shine by images through a part that is a mirror."""
    sources: dict[str, dict] = {"sky": {"type": "tregenza_sky"}}
    each = 1
    if suns is not None:
        directions = mi.TensorXf(suns.directions.astype(np.float32))
        sources["suns"] = {
            "type": "sun_disks", "diameter": suns.diameter, "directions": directions,
        }  # fmt: skip
        # Where disks are found by chance alone, rays to all of them are of no use.
        each = 4 if suns.diameter == WIDE else len(suns.labels)
    integrator = mi.load_dict({"type": "coefficient", "suns_per_vertex": each})
    by_channel = []
    for channel in scene.channels_of(case, EFFECTS):
        world = scene.load(case, channel=channel)
        shapes = {f"shape{i}": shape for i, shape in enumerate(world.full.shapes())}
        for i, part in enumerate(world.parts if mirror else ()):
            if part.name == mirror:
                bsdf = image_mirror(part.material.reflectance)
                shapes[f"shape{i}"] = quad_mesh(mirror, part.quads, bsdf)
        lit = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
        by_channel.append(
            [integrator.sensors(lit, points, normals, spp, i).numpy() for i in range(CHUNKS)]
        )
    return np.stack(by_channel, axis=2)


def evaluated(room: Room, seeds: int) -> np.ndarray:
    """Interreflected light [sr] of every seed, (seed, replicate, channel, sensor, bin)."""
    case = room.case
    points, normals = sensor_points(case)
    effects = replace(EFFECTS, pane_to_pane=room.pane_to_pane)
    worlds = [
        scene.load(case, channel=k, effects=effects) for k in scene.channels_of(case, EFFECTS)
    ]
    out = []
    for seed in range(seeds):
        accuracy = case.accuracy.of_points(len(points)).model_copy(update={"seed": seed})
        each = [coefficients.compute(w, points, normals, room.suns, accuracy) for w in worlds]
        out.append(np.stack([C["replicates"].values - C["direct"].values for C in each], axis=1))
    return np.array(out)


def of_sensors(room: Room, seeds: int) -> list[Coverage]:
    """Coverage of the sky's and of the suns' light, by quarter of the sensors."""
    points, normals = sensor_points(room.case)
    theirs = by_paths(room, room.suns, points, normals, room.paths)[:, 1]
    ours, rows = evaluated(room, seeds), []
    for light, bins in (("sky", PATCHES), ("suns", slice(BINS, None))):
        a, b = ours[..., bins], theirs[..., bins]
        if light == "sky":
            a, b = (x.sum(axis=-1, keepdims=True) for x in (a, b))
        # Sensors first, then what they see of every channel and bin.
        a, b = (np.moveaxis(x, -2, -3).reshape(*x.shape[:-3], x.shape[-2], -1) for x in (a, b))
        order = np.argsort(a.mean(axis=(0, 1)).sum(axis=1))  # less noisy than the truth
        rows += [
            quarter(light, i + 1, a[:, :, some], b[:, some])
            for i, some in enumerate(np.array_split(order, 4))
        ]
    return rows


def of_eyes(room: Room, seeds: int) -> list[Coverage]:
    """Coverage of DGP, by quarter of the pairs of eye and hour."""
    with tempfile.TemporaryDirectory() as folder:
        times = Path(folder) / "times.csv"
        times.write_text("time\n" + "\n".join(HOURS) + "\n")
        period = PeriodTable(timestamps=str(times))
        outside = room.case.outside.model_copy(update={"sun_diameter": room.diameter})
        case = room.case.with_tables(period=period, outside=outside)
        light, looking, rule = daylight(case), eyes(case, room.places), Rule()
        at = looking.points, looking.forward
        C = by_paths(room, light.suns, *at, AT_EYES).sum(axis=1)
        C[..., :BINS] = _of_scene(room.case, None, *at, SKY_AT_EYES).sum(axis=1)
        weights = np.array(list(LUMINANCE_WEIGHTS.values())) if C.shape[1] > 1 else np.ones(1)
        by_bin = light.sky["sky"].transpose("time", "bin").values
        L = np.zeros((len(by_bin), C.shape[-1]))
        L[:, :BINS] = by_bin
        shining = np.flatnonzero(light.sky["sun"].values > 0)
        column = [light.suns.labels.index(str(light.sky["sun_bin"].values[i])) for i in shining]
        L[shining, BINS + np.array(column)] = light.sky["sun"].values[shining]
        E = np.einsum("c,kcvb,tb->ktv", weights, C, L)
        ours, bright = [], []
        for seed in range(seeds):
            accuracy = case.accuracy.model_copy(update={"seed": seed})
            year = drcmitsuba.glare(case.with_tables(accuracy=accuracy), room.places)
            hours = year.hours.isel(state=0).transpose("time", "view")
            ours.append(year.replicates[:, 0])
            bright.append(
                (10 ** hours["contrast"].values - 1) * hours["illuminance"].values ** 1.87
            )
    theirs = rule.dgp(E, np.mean(bright, axis=0))
    a, b = (x.reshape(*x.shape[:-2], -1, 1) for x in (np.array(ours), theirs))
    order = np.argsort(a.mean(axis=(0, 1))[:, 0])
    return [
        quarter("glare", i + 1, a[:, :, some], b[:, some])
        for i, some in enumerate(np.array_split(order, 4))
    ]


PLACES = {"sensors": of_sensors, "eyes": of_eyes}
"""Coverage by kind of light and quarter of brightness, the darkest first, by where it is known."""


def quarter(light: str, number: int, ours: np.ndarray, theirs: np.ndarray) -> Coverage:
    """Coverage of (seed, replicate, place, entry) against (chunk, place, entry)."""
    error = theirs.std(axis=0, ddof=1) / np.sqrt(len(theirs))
    replicates = ours.shape[1]
    value = ours.mean(axis=1)
    stated = ours.std(axis=1, ddof=1) / np.sqrt(replicates)
    factor = student.isf(0.025, replicates - 1)
    lit = (mean := theirs.mean(axis=0)) > FAINT * mean.max()

    def shares(truth: np.ndarray) -> np.ndarray:
        held = np.abs(value - truth) <= factor * np.hypot(stated, error)
        return held[:, lit].mean(axis=1)

    share = shares(mean)
    rng = np.random.default_rng(0)
    runs = rng.integers(len(theirs), size=(RESAMPLED, len(theirs)))
    by_reference = [shares(theirs[some].mean(axis=0)).mean() for some in runs]
    share_error = np.hypot(share.std(ddof=1) / np.sqrt(len(share)), np.std(by_reference))
    sums, whole = value.sum(axis=(1, 2)), theirs.sum(axis=(1, 2))
    noise = np.hypot(sums.std(ddof=1) / np.sqrt(len(sums)), whole.std(ddof=1) / np.sqrt(len(whole)))
    return Coverage(
        light, number, float(sums.mean() / whole.mean() - 1), float(noise / whole.mean()),
        float(share.mean()), float(share_error),
        float(np.median(stated[:, lit] / mean[lit])),
    )  # fmt: skip
