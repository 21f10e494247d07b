"""The table `[model]` of a case: files of a building that was drawn elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from drcmitsuba.case.groups import OPEN, told_apart
from drcmitsuba.case.unit_check import ask_about_model
from drcmitsuba.model.group_states import in_first_state, in_states
from drcmitsuba.model.materials import (
    Lambertian,
    Reflectance,
    SurfaceMaterial,
    two_sided,
)
from drcmitsuba.model.model import (
    Layer,
    Model,
    joined,
    with_printable_names,
)
from drcmitsuba.model.unstated import without_stated
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Name, Table, choose, fits, shortened, unmet

METRES = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
"""Metres per unit."""
RADIANCE, HONEYBEE = (".rad", ".mat"), (".hbjson", ".json")
MESHES = (".obj", ".ply", ".stl", ".gltf", ".glb")
XML, GBXML, IFC, VIEWS = (".xml",), (".gbxml",), (".ifc",), (".vf",)
ENDINGS = (*RADIANCE, *HONEYBEE, *MESHES, *XML, *GBXML, *IFC, *VIEWS)
"""Endings of the files that a model may consist of."""

Patterns = Annotated[tuple[Name, ...], Field(max_length=1000)]


class ModelTable(Table):
    """Files of a model. A material of `[materials]` replaces that of the same name in the files."""

    files: Annotated[tuple[Path, ...], Field(min_length=1, max_length=1000)]
    """Radiance scenes in the order of `oconv`, Honeybee models, buildings in gbXML (`.xml` or
    `.gbxml`) and IFC, Mitsuba scenes, meshes, and views of Radiance (`.vf`)."""
    unit: Literal["m", "dm", "cm", "mm", "ft", "in"] | None = None
    """Unit of meshes and Mitsuba scenes without one; Radiance scenes are in metres by default."""
    up: Literal["z", "y"] = "z"
    """Axis of OBJ, PLY and STL files that is up; glTF has y up in any case."""
    north: Annotated[float, Field(ge=-360, le=360)] | None = None
    """Direction of true north, clockwise from the model's y axis [deg]; by default the model's."""
    reflectances: dict[Name, Reflectance] = Field(default_factory=dict)
    """Diffuse reflectances [–] that replace materials of the files, by name."""
    context: Patterns = ()
    """Names of materials of bodies outside: buildings, trees, terrain; `*` stands for any text."""
    leave_out: Patterns = ()
    """Names of materials whose surfaces are left out; `*` stands for any text."""
    states: dict[Name, Name] = Field(default_factory=dict)
    """State in which a group of the files stays in all tasks: the name of its material, `open` for
    the first one, or its number, such as `tree = "winter"`. A group has this or the states of a
    table `[groups.NAME]`; without either it stays in its first state."""
    windows: Path | None = None
    """Table of new windows, as `optimise` writes it (`windows.csv`): they are cut out of the walls
    in whose planes they lie."""
    means: bool = False
    """Whether Radiance's patterns and textures count with their mean; else they are refused."""
    leaks: Literal["refuse", "allow"] = "refuse"
    """Whether the rooms of the sensors may be open to the sky where there is no pane."""

    def read(
        self, source: str, files: tuple[Path, ...], materials: Mapping[str, SurfaceMaterial]
    ) -> Model:
        """Read the files, whose paths are given, with the materials that the case puts in place.

        Raises
        ------
        InputError
            A file is missing or unfit, of an unknown kind, or holds nothing of a given name.
        """
        from drcmitsuba.model.gbxml import is_gbxml  # when they are needed only
        from drcmitsuba.model.gbxml import read as read_gbxml
        from drcmitsuba.model.honeybee import read as read_honeybee
        from drcmitsuba.model.ifc import read as read_ifc
        from drcmitsuba.model.mesh import read as read_mesh
        from drcmitsuba.model.mitsuba import read as read_mitsuba
        from drcmitsuba.model.radiance import read as read_radiance
        from drcmitsuba.model.radiance import read_views

        scale = None if self.unit is None else METRES[self.unit]
        own = {**materials, **{n: Lambertian(r) for n, r in self.reflectances.items()}}
        parts = []
        if scenes := [f for f in files if f.suffix.lower() in RADIANCE]:
            parts.append(read_radiance(scenes, means=self.means).scaled(scale or 1.0))
        for file in files:
            ending = file.suffix.lower()
            if ending in HONEYBEE:
                parts.append(read_honeybee(file))
            elif ending in MESHES:
                parts.append(read_mesh(file, unit=scale, up=self.up, materials=own))
            elif ending in VIEWS:
                parts.append(Model(views=read_views(file)).scaled(scale or 1.0))
            elif ending in GBXML or (ending in XML and is_gbxml(file)):
                parts.append(read_gbxml(file))
            elif ending in IFC:
                parts.append(read_ifc(file))
            elif ending in XML:
                parts.append(read_mitsuba(file, unit=scale, materials=own))
            elif ending not in RADIANCE:
                remedy = f"give one of {', '.join(ENDINGS)}"
                raise InputError(file, "model.files", f"ending {ending or 'none'}", remedy)
        model = in_first_state(with_printable_names(joined(parts)))
        in_all_states = [name for layer in model.layers for name in _with_states(layer)]
        model = in_states(model, _numbers_of(model, self.states, source))
        every = [name for layer in model.layers for name in layer.names]
        for field, wanted, known in (
            ("context", self.context, every), ("leave_out", self.leave_out, every),
            ("reflectances", tuple(self.reflectances), in_all_states),
        ):  # fmt: skip
            for pattern in unmet(wanted, known):
                got = f"no surface has the material {shortened(pattern)}"
                raise InputError(source, f"model.{field}", got, choose(pattern, known))
        left = [
            replace(layer, role="context") if fits(layer.name, self.context) else layer
            for layer in model.layers
            if not self._leaves_out(layer)
        ]
        kept, numbered = self._named(left, own, source)
        if not kept:
            remedy = "give files with polygons or meshes"
            raise InputError(source, "model.files", "they hold no surface", remedy)
        if self.unit is None:
            ask_about_model(source, kept)
        north = model.north if self.north is None else self.north
        notes = without_stated(model.notes, own)
        if numbered:
            names = ", ".join(numbered)
            notes += (f"Panes of another material than others of their name: {names}.",)
        return replace(model, layers=kept, north=north, notes=notes)

    def _named(
        self, layers: list[Layer], own: Mapping[str, SurfaceMaterial], source: str
    ) -> tuple[tuple[Layer, ...], tuple[str, ...]]:
        """Settled layers, whose panes differ in name where they do in material, and the new names.

        The case may name a material by the new name; that of the first name replaces all others.
        """
        settled, numbered = [], dict[str, None]()
        for layer, named in zip(layers, _numbered(layers), strict=True):
            is_new = named.name != layer.name and (named.name in own or layer.name not in own)
            numbered |= {named.name: None} if is_new else {}
            settled.append(self._settled(named if is_new else layer, own, source))
        return tuple(settled), tuple(numbered)

    def _leaves_out(self, layer: Layer) -> bool:
        """Whether the materials of all sides of a layer are named to be left out."""
        return all(fits(n, self.leave_out) for n in layer.names)

    def _settled(self, layer: Layer, own: Mapping[str, SurfaceMaterial], source: str) -> Layer:
        """Layer with the case's material and role."""
        if layer.behind:
            front, back = layer.sides
            front, back = own.get(layer.name, front), own.get(layer.behind, back)
            if isinstance(front, Lambertian) and isinstance(back, Lambertian):
                layer = layer.made_of(two_sided(front, back))
            else:
                names = f"{shortened(layer.name)} and {shortened(layer.behind)}"
                got = f"{names}, the sides of one surface, of which one is not diffuse"
                raise InputError(source, "materials", got, "give both a diffuse reflectance")
        else:
            layer = layer.made_of(own.get(layer.name, layer.material))
        states = tuple(
            replace(
                state,
                material=own.get(state.name, state.material) if state.material else None,
                shades=tuple(
                    self._settled(shade, own, source)
                    for shade in state.shades
                    if not self._leaves_out(shade)
                ),
            )
            for state in layer.states
        )
        layer = replace(layer, states=states) if states else layer
        if fits(layer.name, self.context):
            return replace(layer, role="context")
        return layer


def _numbered(layers: Sequence[Layer]) -> tuple[Layer, ...]:
    """Layers whose panes differ in name where they do in material: further ones are numbered."""
    taken, names = {layer.name for layer in layers}, dict[str, dict[str, str]]()
    out = []
    for layer in layers:
        if layer.role == "pane":
            own, material = layer.name, repr(layer.material)
            known = names.setdefault(own, {})
            if known and material not in known:
                own = next(n for k in count(2) if (n := f"{layer.name} ({k})") not in taken)
                taken.add(own)
            layer = replace(layer, name=known.setdefault(material, own))
        out.append(layer)
    return tuple(out)


def _numbers_of(model: Model, names: Mapping[str, str], source: str) -> dict[str, int]:
    """Numbers of the states of groups, which are named as in `[groups]`."""
    numbers = {}
    for group, name in names.items():
        layers = [layer for layer in model.layers if layer.group == group and layer.states]
        if not layers:
            known = dict.fromkeys(layer.group for layer in model.layers if layer.states)
            got, remedy = "the model has no such group of states", choose(group, [*known])
            raise InputError(source, f"model.states.{shortened(group)}", got, remedy)
        panes = [layer for layer in layers if layer.role == "pane"]
        first, *further = max((layer.states for layer in panes or layers), key=len)
        states = OPEN, *told_apart(tuple(state.name for state in further))
        number = {str(i): i for i in range(len(states))}
        number |= {state: i for i, state in enumerate(states)} | {first.name: 0}
        if name not in number or (name == first.name and name in states):
            remedy = choose(name, [first.name, *states])
            if name in number:
                remedy = f"two states have this name: give a number, 0 to {len(further)}"
            raise InputError(source, f"model.states.{group}", shortened(name), remedy)
        numbers[group] = number[name]
        if number[name] and any(_is_hole(layer, number[name]) for layer in panes):
            remedy = f"simulate this state by a schedule of [groups.{group}]"
            got = f"{shortened(name)} leaves an opening in place of a pane"
            raise InputError(source, f"model.states.{group}", got, remedy)
    return numbers


def _is_hole(layer: Layer, state: int) -> bool:
    return layer.states[min(state, len(layer.states) - 1)].material is None


def _with_states(layer: Layer) -> Iterator[str]:
    """Names of a layer's materials in all states of its group."""
    yield from layer.names
    for state in layer.states:
        yield state.name
        yield from (name for shade in state.shades for name in shade.names)
