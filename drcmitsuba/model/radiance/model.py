"""Radiance's scene files as a model: one layer for each modifier of surfaces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from drcmitsuba.model.materials import SurfaceMaterial
from drcmitsuba.model.model import Layer, Model, role_of
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.radiance.context import Budget, Context
from drcmitsuba.model.radiance.definitions import Definition, Definitions
from drcmitsuba.model.radiance.films import Mounted, upside_down
from drcmitsuba.model.radiance.materials import material_of
from drcmitsuba.model.radiance.reading import read_file
from drcmitsuba.model.radiance.surfaces import Patch, SurfacesByModifier, joined


def read(files: Sequence[Path], *, means: bool = False) -> Model:
    """Read scene files, in turn, as `oconv` does.

    Parameters
    ----------
    files : sequence of Path
        Scene files; modifiers that one defines serve in the next. Files, BSDF files and function
        files that they name are looked for beside the file that names them, beside those that call
        for it, beside the other scene files, and in the present folder.
    means : bool
        Whether patterns, textures and mixtures that are not constant count as their mean, with a
        note, and are not refused.

    Returns
    -------
    Model
        Layers by modifier, in metres as the files are; fronts are those of the files. Layers of
        glass, diffusers and measured BSDFs have the role "pane", `trans` that scatters nothing
        "context", all others "surface".

    Raises
    ------
    InputError
        A file cannot be read, or holds something without a counterpart here.
    """
    notes = Notes()
    folders = tuple(dict.fromkeys(Path(file).parent for file in files))
    context = Context(Definitions(), SurfacesByModifier(notes), Budget(), notes, given=folders)
    for file in files:
        read_file(Path(file), context)
    gathered: dict[tuple[str, str], tuple[SurfaceMaterial, list[Patch]]] = {}
    for definition, patch in context.surfaces.patches().items():
        for material, part in _finished(definition, patch, means, notes):
            name = definition.name if definition else ""
            gathered.setdefault((name, repr(material)), (material, []))[1].append(part)
    names: dict[str, int] = {}
    layers = []
    for (name, _), (material, patches) in gathered.items():
        names[name] = names.get(name, 0) + 1
        whole = joined(patches)
        layers.append(
            Layer(
                name=name if names[name] == 1 else f"{name} ({names[name]})",
                material=material,
                role=role_of(material),
                quads=whole.quads,
                polygon=whole.polygon,
                places=whole.places,
            )
        )
    return Model(layers=tuple(layers), notes=notes.sentences())


def _finished(
    definition: Definition | None, patch: Patch, means: bool, notes: Notes
) -> Iterator[tuple[SurfaceMaterial, Patch]]:
    """Surfaces with their material; those of a measured pane by how they are mounted."""
    material = material_of(definition, means, notes)
    if material is None or not len(patch.quads):
        return
    if not isinstance(material, Mounted):
        yield material, patch
        return
    turned = upside_down(material, patch.quads)
    for turn in (False, True):
        if (turned == turn).any():
            mounted = material.material.model_copy(update={"turn": turn})
            yield mounted, _selected(patch, turned == turn)


def _selected(patch: Patch, which: np.ndarray) -> Patch:
    """Some quads of a patch, with the places of their polygons."""
    used, index = np.unique(patch.polygon[which], return_inverse=True)
    return Patch(patch.quads[which], index, tuple(patch.places[i] for i in used))
