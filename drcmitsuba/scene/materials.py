"""Materials of the case as Mitsuba BSDFs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from drcmitsuba_plugins import energy, peak
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.grazing import more_at_grazing

from drcmitsuba import bsdf as bsdf_files
from drcmitsuba.model.materials import (
    BsdfInBand,
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
    Reflectance,
    SurfaceMaterial,
)
from drcmitsuba.runtime.content_key import file_numbers
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import turn
from drcmitsuba.schema import LUMINANCE_WEIGHTS

STEPS = 1025
"""Number of cosines at which panes with a refractive index are tabulated: exact to 1e-4."""


@dataclass(frozen=True)
class FilmFile:
    """BSDF file of a film, with its energy and its straight-through peak."""

    file: BsdfFile
    largest_albedo: float
    """Largest T + R over the incidences of the file, which is scaled down to 1 at most."""
    share_through: float
    """Share of the transmitted light that goes straight through."""
    stands_out: bool
    """Whether that share is a peak and not the flank of a lobe."""

    @property
    def coloured(self) -> bool:
        """Whether the file holds chromaticity."""
        return bool(self.file.colour)


def film(path: Path) -> FilmFile:
    """Read the BSDF file of a material.

    Raises
    ------
    InputError
        The file cannot be read, or its T + R exceeds 1.05.
    """
    return _film(path, file_numbers(path))


@lru_cache(maxsize=16)
def _film(path: Path, written: tuple[int, ...]) -> FilmFile:
    file = bsdf_files.read(path)
    try:
        if file.colour:
            for channel in range(3):
                energy.scaled_to_conserve(file.of_channel(channel))
        file, largest = energy.scaled_to_conserve(file)
    except ValueError as error:
        raise InputError(path, "energy", str(error), f"see `drcmitsuba bsdf {path.name}`") from None
    splits = [peak.split(c) for n, c in file.components.items() if n.startswith("t")]
    share = max((s.share for s in splits), default=0.0)
    return FilmFile(file, largest, share, any(s.stands_out for s in splits))


def shade_covers(material: SurfaceMaterial | None) -> bool:
    """Whether a shade covers what stands in an opening: clear glass, or a hole, which is None."""
    return material is None or isinstance(material, GlazingMaterial)


def lets_through(material: SurfaceMaterial) -> bool:
    """Whether straight light passes a surface of this material undeviated."""
    if isinstance(material, BsdfMaterial):
        measured = film(material.file)
        by_mode = {"auto": measured.stands_out, "on": measured.share_through > 0, "off": False}
        return by_mode[material.straight_through]
    if isinstance(material, PorousMaterial):
        return material.porosity > 0
    if isinstance(material, DiffuserMaterial):
        return material.most_straight > 0
    return isinstance(material, GlazingMaterial)


def is_diffuse(material: SurfaceMaterial) -> bool:
    """Whether light is deposited on a surface: no pane, and some of its reflection is diffuse."""
    if isinstance(material, MirrorMaterial):
        return material.specular < 1
    return isinstance(material, Lambertian | PorousMaterial)


def ends_paths(material: SurfaceMaterial) -> bool:
    """Whether a pane reflects nothing into a room."""
    return isinstance(material, GlazingMaterial | DiffuserMaterial) and not any(material.sides)


def is_mirroring_glass(material: SurfaceMaterial | None) -> bool:
    """Whether a pane is of clear glass that mirrors light into a room."""
    return isinstance(material, GlazingMaterial) and material.reflectance > 0


def channel_of(reflectance: Reflectance, channel: int) -> float:
    """Reflectance in one colour channel, or of luminance (−1); grey is the same in all."""
    if channel < 0 and isinstance(reflectance, tuple):
        weighted = zip(LUMINANCE_WEIGHTS.values(), reflectance, strict=True)
        return float(sum(weight * value for weight, value in weighted))
    return float(reflectance[channel] if isinstance(reflectance, tuple) else reflectance)


def max_reflectance(reflectance: Reflectance) -> float:
    """Largest reflectance of any colour channel."""
    return float(max(reflectance) if isinstance(reflectance, tuple) else reflectance)


def mean_albedo(material: SurfaceMaterial) -> float:
    """Largest share that a surface sends on of light that comes from everywhere alike, ≤ 1."""
    if isinstance(material, MirrorMaterial) and material.polished:
        c = (np.arange(512) + 0.5) / 512
        more = float((2 * c * more_at_grazing(c)).mean())
        return material.reflectance + (1 - material.reflectance) * more
    return albedo(material)


def albedo(material: SurfaceMaterial) -> float:
    """Largest share of the arriving light that a surface reflects and transmits together, ≤ 1."""
    if isinstance(material, Lambertian):
        return max(map(max_reflectance, material.sides))
    if isinstance(material, MirrorMaterial):
        return 1.0 if material.polished else material.reflectance
    if isinstance(material, PorousMaterial):
        gaps = material.porosity
        return gaps + (1 - gaps) * max_reflectance(material.reflectance)
    if isinstance(material, DiffuserMaterial):
        return min(1.0, material.most_through + max(material.sides))
    if isinstance(material, GlazingMaterial):
        return min(1.0, material.transmittance + material.reflectance)
    if isinstance(material, BsdfMaterial):
        return min(1.0, film(material.file).largest_albedo)
    assert isinstance(material, DielectricMaterial)
    return 1.0


def loaded(material: SurfaceMaterial, channel: int = 0, clockwise: float = 0.0) -> Any:
    """Load the BSDF of a material as `mi.BSDF`; nobody may change the parameters of a film's.

    Arguments are those of `bsdf`.

    The film's tables are made once for all scenes: states of a façade, forecasts, further runs.
    """
    if not isinstance(material, BsdfMaterial):
        return mi.load_dict(bsdf(material, channel))
    description = tuple(bsdf(material, channel, clockwise).items())
    return _loaded_film(description, file_numbers(material.file), str(mi.variant()))


@lru_cache(maxsize=8)
def _loaded_film(
    description: tuple[tuple[str, Any], ...], written: tuple[int, ...], variant: str
) -> Any:
    return mi.load_dict(dict(description))


def _uniform(value: float) -> dict[str, Any]:
    return {"type": "uniform", "value": value}


def _rough(alpha: float, distribution: str = "ggx") -> dict[str, Any]:
    return {"alpha": alpha, "distribution": distribution}


def _matt(front: float, back: float) -> dict[str, Any]:
    """Diffuse sheet of a reflectance on each side."""
    sheet: dict[str, Any] = {
        "type": "twosided",
        "front": {"type": "diffuse", "reflectance": _uniform(front)},
    }
    if back != front:
        sheet["opposite"] = {"type": "diffuse", "reflectance": _uniform(back)}
    return sheet


def _mirror(material: MirrorMaterial) -> dict[str, Any]:
    """One side of a mirror: its mirrored part, its diffuse part, or both."""
    if material.polished:
        return {"type": "polished", "mirrored": material.mirrored, "matt": material.matt}
    matt = {"type": "diffuse", "reflectance": _uniform(material.reflectance)}
    if material.specular == 0:
        return matt
    clear: dict[str, Any]
    if material.coating is not None:
        rho, ior = material.reflectance, material.coating
        clear = {"type": "coated_mirror", "reflectance": rho, "ior": ior}
    else:
        shine = _uniform(material.reflectance)
        clear = {"type": "conductor", "material": "none", "specular_reflectance": shine}
        if material.roughness:
            clear |= {"type": "roughconductor"} | _rough(material.roughness, material.distribution)
    if material.specular == 1:
        return clear
    return {"type": "blendbsdf", "weight": material.specular, "first": matt, "second": clear}


def bsdf(material: SurfaceMaterial, channel: int = 0, clockwise: float = 0.0) -> dict[str, Any]:
    """Mitsuba dictionary of a material.

    Parameters
    ----------
    channel : int
        Colour channel that is simulated: 0 for grey and red, 1 for green, 2 for blue; −1 for
        luminance.
    clockwise : float
        Angle of the room in the world [deg], with which the y axis of horizontal films turns.

    Returns
    -------
    dict
        Argument of `mi.load_dict`. Glass reflects towards the room only, because light reflected
        to the outside returns to a sensor only by way of other surfaces there; that with a
        refractive index mirrors on both sides. Measured panes keep the reflection of their file.
    """
    if isinstance(material, BsdfMaterial):
        measured = film(material.file)
        mix = material.mix if isinstance(material, BsdfInBand) else None
        if mix is not None and not measured.coloured and abs(sum(mix) - 1) < 1e-9:
            mix = None  # a grey film is the same in all bands
        weights = mix[0] if mix is not None and len(mix) == 1 else mix
        return ({} if weights is None else {"mix": weights}) | {
            "type": "klems" if measured.file.kind == "Klems" else "tensor_tree",
            "filename": str(material.file),
            # Luminance decides, so that all channels and `lets_through` agree.
            "straight_through": "on" if lets_through(material) else "off",
            "flip": material.flip,
            "turn": material.turn,
            "level": tuple((turn(clockwise) @ (0.0, 1.0, 0.0)).tolist()),
            "channel": channel if measured.coloured else -1,
        }
    if isinstance(material, Lambertian):
        return _matt(*(channel_of(rho, channel) for rho in material.sides))
    if isinstance(material, PorousMaterial):
        solid = _matt(*2 * [channel_of(material.reflectance, channel)])
        return {"type": "mask", "opacity": _uniform(1 - material.porosity), "solid": solid}
    if isinstance(material, MirrorMaterial):
        return {"type": "twosided", "bsdf": _mirror(material)}
    if isinstance(material, DielectricMaterial):
        solid = {"type": "dielectric", "int_ior": material.ior, "ext_ior": 1.0}
        if material.roughness:
            solid |= {"type": "roughdielectric"} | _rough(material.roughness)
        return solid
    pane: dict[str, Any] = {
        "type": "diffuser",
        "transmittance": _by_incidence(material.transmittance),
        "reflectance_front": material.reflectance,
        "reflectance_back": 0.0,
    }
    if isinstance(material, GlazingMaterial):
        pane |= {"type": "glazing", "exponent": material.exponent}
        if material.ior is not None:
            tables = (mi.TensorXf(t.astype(np.float32)) for t in material.tables(STEPS))
            pane["transmittance"], pane["reflectance_front"] = tables
            del pane["exponent"], pane["reflectance_back"]  # both sides mirror
    else:
        pane["reflectance_back"] = material.outer_reflectance
        if material.most_straight > 0:
            pane["straight"] = _by_incidence(material.straight)
    return pane


def _by_incidence(share: float | tuple[float, ...]) -> Any:
    """Share of the light as a plugin takes it: one number, or a table over the cosine."""
    if not isinstance(share, tuple):
        return share
    table = np.array(share, np.float32)
    if len(table) == 3:  # Mitsuba takes three numbers for a colour, and complains on stderr
        table = np.interp([0, 1, 2, 3, 4], [0, 2, 4], table).astype(np.float32)
    return mi.TensorXf(table)
