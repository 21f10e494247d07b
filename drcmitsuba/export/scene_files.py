"""Surfaces of a case as the files of a scene: materials, polygons and the BSDF files they need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from drcmitsuba.export.primitives import are_level, identifier, polygons, twin
from drcmitsuba.model.materials import BsdfMaterial, MirrorMaterial
from drcmitsuba.scene.geometry import Surface

FILMS = (
    "Radiance looks up a BSDF with the viewer as incident and decides by itself whether light goes "
    "straight through"
)
MIRRORS = "Radiance finds the sun by way of mirrors and prisms by chance alone; mkpmap finds it"


@dataclass(frozen=True)
class SceneFiles:
    """Scene without light sources."""

    materials: str
    polygons: str
    films: dict[Path, str]
    """BSDF files, with the name of each beside the scene."""
    differences: tuple[str, ...]
    """How Radiance's materials differ from the engine's."""


def scene_files(surfaces: Sequence[Surface], clockwise: float = 0.0) -> SceneFiles:
    """Write surfaces as materials and polygons of Radiance.

    The modifier of part i is its surface's name with `.i` behind it. Horizontal films are turned
    `clockwise` with the room [deg].
    """
    materials, shapes, differences = [], [], []
    films: dict[Path, str] = {}
    for i, surface in enumerate(part for each in surfaces for part in _oriented(each)):
        material, modifier = surface.material, f"{identifier(surface.name)}.{i}"
        file = ""
        if isinstance(material, BsdfMaterial):
            file = films.setdefault(material.file, f"film_{len(films) + 1}.xml")
            differences.append(FILMS)
        elif surface.component or isinstance(material, MirrorMaterial):
            differences.append(MIRRORS)
        made = twin(modifier, material, surface.quads, file, clockwise)
        differences.append(made.difference)
        materials.append(made.text)
        shapes += polygons(modifier, material, surface.quads)
    remarks = tuple(d for d in dict.fromkeys(differences) if d)
    return SceneFiles(_lines(materials), _lines(shapes), films, remarks)


def _oriented(surface: Surface) -> list[Surface]:
    """Parts of a surface with one primitive each: level measured panes have another `up`."""
    if not isinstance(surface.material, BsdfMaterial):
        return [surface]
    level, quads = are_level(surface.quads), surface.quads
    return [replace(surface, quads=quads[some]) for some in (~level, level) if some.any()]


def _lines(lines: list[str]) -> str:
    return "".join(f"{line}\n" for line in lines)
