"""From a case file to a case: its tables checked, its paths made absolute, its model read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.components import MeshComponent, StructureComponent
from drcmitsuba.case.model import ENDINGS
from drcmitsuba.case.model_case import tables_of, usual_sensors
from drcmitsuba.case.sensors import PointSensors
from drcmitsuba.case.shipped import locate_case
from drcmitsuba.case.spaces import with_tables
from drcmitsuba.case.sun import Adaptive, check_sun
from drcmitsuba.case.uses import with_uses
from drcmitsuba.model.materials import BsdfMaterial, Lambertian
from drcmitsuba.model.model import Model
from drcmitsuba.model.window_table import read_windows
from drcmitsuba.model.windows import with_windows
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked, choose, is_file, read_toml, shortened

MAX_BYTES = 1 << 20
"""Largest size of a case file [bytes]."""
MOST_IDLE = 3
"""Largest number of notes on materials that nothing has."""


def load_case(path: str | Path) -> Case:
    """Read and check a case file.

    Parameters
    ----------
    path : str or Path
        A TOML file, a file of a model, or the name of a shipped case (`classroom/existing`).

    Returns
    -------
    Case

    Raises
    ------
    InputError
        The file is missing or no TOML, or has an unknown key or a value out of its range.

    Examples
    --------
    >>> import drcmitsuba
    >>> case = drcmitsuba.load_case("classroom/existing")  # or the path of a case of your own
    >>> case.name, case.room.size
    ('classroom, existing façade', (8.8, 9.05, 3.63))
    """
    file = locate_case(path)
    is_model = file.suffix.lower() in ENDINGS
    case = case_from(tables_of(file) if is_model else read_toml(file, MAX_BYTES), file)
    if is_model:
        case = case.with_tables(sensors=usual_sensors(case.source, case.building))
    return case


def case_of_settings(settings: dict[str, Any], source: str | Path) -> Case:
    """Case of the settings that results hold; its `[design]`, which no result depends on, is left.

    Settings hold the values of all keys, of which a design has those of its kind alone.

    Raises
    ------
    InputError
        The settings make no case.
    """
    known = {k: v for k, v in settings.items() if k in Case.model_fields and k != "design"}
    return checked(Case, known, source)


def case_from(tables: dict[str, Any], file: Path) -> Case:
    """Check the tables of a case file; the paths in them are relative to the `file`."""
    case = checked(Case, tables, file)
    # Results name the files, which later commands read from any folder.
    case._source, case._folder = str(file), file.parent.absolute()
    return with_files(case)


def with_files(case: Case) -> Case:
    """Make the paths of materials and components absolute, and read the model.

    A missing file, or an unfit one of the model, raises InputError.
    """

    def resolved(
        file: Path, field: str, remedy: str = "give its path relative to the case file"
    ) -> Path:
        path = case.path(file)
        if not is_file(path, case.source, field):
            raise InputError(case.source, field, f"{file}: no such file", remedy)
        return path

    for name, material in case.materials.items():
        if isinstance(material, BsdfMaterial):
            path = resolved(material.file, f"materials.{name}.file")
            case.materials[name] = material.model_copy(update={"file": path})
    for name, tint in case.colour.spectra.items():
        if isinstance(tint, Path):
            case.colour.spectra[name] = resolved(tint, f"colour.spectra.{name}")
    of_sources = {
        key: resolved(value, f"colour.{key}", f"give {models}, a temperature [K] or a file")
        for key, value, models in (
            ("sky", case.colour.sky, "chain, takagi"), ("sun", case.colour.sun, "spectrl2"),
        )
        if isinstance(value, Path)
    }  # fmt: skip
    if of_sources:
        case = case.with_tables(colour=case.colour.model_copy(update=of_sources))
    for name, component in case.components.items():
        if isinstance(component, StructureComponent | MeshComponent):
            key = "recipe" if isinstance(component, StructureComponent) else "file"
            path = resolved(getattr(component, key), f"components.{name}.{key}")
            case.components[name] = component.model_copy(update={key: path})
    for name, group in case.groups.items():
        if group.schedule is not None:
            path = resolved(group.schedule, f"groups.{name}.schedule")
            case.groups[name] = group.model_copy(update={"schedule": path})
    sensors, table = case.sensors, case.model
    if isinstance(sensors, PointSensors) and isinstance(sensors.points, Path):
        points = resolved(sensors.points, "sensors.points")
        case = case.with_tables(sensors=sensors.model_copy(update={"points": points}))
    if table is not None:
        files = tuple(resolved(f, f"model.files.{i}") for i, f in enumerate(table.files))
        case = case.with_tables(model=table.model_copy(update={"files": files}))
        building = table.read(case.source, files, case.materials)
        known = with_tables(building.spaces, case.spaces, case.source)
        hours = case.period.hours if case.period.timestamps is None else (0, 24)
        spaces, note = with_uses(known, case.uses, case.source, hours)
        notes = (*building.notes, note) if note else building.notes
        building = replace(building, spaces=spaces, notes=notes)
        if table.windows is not None:
            file = resolved(table.windows, "model.windows")
            case = case.with_tables(
                model=table.model_copy(update={"files": files, "windows": file})
            )
            panes = {x.name: x.material for x in building.layers if x.role == "pane"}
            kinds = panes | {name: case.materials[name] for name in case.panes}
            building = with_windows(building, read_windows(file, [*kinds]), kinds)
        building = replace(building, notes=(*building.notes, *_unused(case, building)))
        # Sums over groups and meshes of suns count no light by way of mirrors.
        dull = bool(case.groups) or isinstance(case.sun, Adaptive)
        dull = dull or case.effects.components == "off"
        case._building = building.without_polish() if dull else building
        check_sun(case.sun, case.effects, bool(case.standing))
        layers = [layer for layer in case.building.layers if layer.role == "pane"]
        for layer in layers:  # strips and panes name their materials alike
            if not isinstance(layer.material, Lambertian):
                case.materials.setdefault(layer.name, layer.material)
        for layer in layers:  # after all panes, whose names come first
            for state in layer.states[1:] if layer.group in case.groups else ():
                if state.material is not None and not isinstance(state.material, Lambertian):
                    case.materials.setdefault(state.name, state.material)
    return case.with_tables(accuracy=fitted(case.accuracy, case))


def fitted(accuracy: Accuracy, case: Case) -> Accuracy:
    """Accuracy whose cells fit the rooms of a case, and whose photons its number of components."""
    fit = accuracy.of_components(len({*case.standing}))
    return fit if case.extent is None else fit.of_rooms(case.extent)


def _unused(case: Case, building: Model) -> tuple[str, ...]:
    """Note on materials that no surface of a model has, and that no other table names."""
    layers = [each for layer in building.layers for each in (layer, *layer.added)]
    names = {name for layer in layers for name in layer.names}
    names |= {state.name for layer in layers for state in layer.states}
    words = {*_texts(case.model_dump(mode="json", exclude={"materials"}))}
    idle = [name for name in case.materials if name not in names | words]
    return tuple(
        f"no surface of the model has the material {shortened(name)} of [materials], and no table "
        f"names it; {choose(name, sorted(names))}"
        for name in idle[:MOST_IDLE]
    )


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts within plain values."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)
