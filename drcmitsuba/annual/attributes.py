"""Attributes of C: the case and its weather, its groups of panes, and a digest of all of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from functools import lru_cache, reduce
from operator import getitem
from pathlib import Path
from typing import Any

from drcmitsuba.case.case import Case
from drcmitsuba.case.components import MeshComponent, StructureComponent
from drcmitsuba.case.schedule import schedule_of
from drcmitsuba.case.sensors import PointSensors
from drcmitsuba.metrics import illuminance
from drcmitsuba.model.materials import BsdfMaterial
from drcmitsuba.runtime.content_key import file_numbers
from drcmitsuba.runtime.provenance import METHOD
from drcmitsuba.runtime.release import RELEASE
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.structures.recipe import Mesh, load_recipe
from drcmitsuba.sky.daylight import Daylight


def fingerprint(case: Case, enabled_effects: EnabledEffects) -> str:
    """Digest of everything that determines C, the contents of files included."""
    names = {"room", "facade", "materials", "components", "furniture", "sensors", "shading", "sun"}
    names |= {name for name in ("model", "groups", "spaces") if getattr(case, name)}
    settings = case.model_dump(mode="json", include=names | {"accuracy"})
    for name in ("target", "time_limit"):
        del settings["accuracy"][name]
    settings["accuracy"]["stated"] = case.accuracy.stated
    chosen = {k: v for k, v in case.effects.overruled.items() if k != "dark_hours"}
    settings |= {
        "effects": chosen,
        "scope": {k: v for k, v in enabled_effects.to_dict().items() if k != "suns"},
        "subdivision": case.sky.subdivision,
        "diameter": case.outside.sun_diameter,
    }
    for table in settings.get("spaces", {}).values():
        for name in ("use", "storey", "threshold", "hours", "power"):
            del table[name]
    if case.output.spaces:
        settings["in_spaces"] = case.output.spaces
    if case.model is not None:
        del settings["model"]["files"], settings["model"]["windows"]
    for (*tables, key), content in _contents(case):
        reduce(getitem, tables, settings)[key] = content
    return _digest(settings)[:16]


def _contents(case: Case) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the files that light depends on, by the tables and the key that name them."""
    if case.model is not None:  # by what is read of its files, and of all that they call for
        yield ("model", "content"), case.building.digest
    if isinstance(case.sensors, PointSensors) and isinstance(case.sensors.points, Path):
        yield ("sensors", "points"), _file_digest(case.sensors.points)
    for name, group in case.groups.items():
        if group.schedule is not None:
            yield ("groups", name, "schedule"), _file_digest(group.schedule)
    for name, material in case.materials.items():
        if isinstance(material, BsdfMaterial):
            yield ("materials", name, "file"), _file_digest(material.file)
    for name, component in case.components.items():
        if isinstance(component, StructureComponent):
            recipe = load_recipe(component.recipe)
            yield ("components", name, "recipe"), recipe.model_dump(mode="json")
            if isinstance(recipe.structure, Mesh):
                file = recipe.path(recipe.structure.file)
                yield ("components", name, "mesh"), _file_digest(file)
        elif isinstance(component, MeshComponent):
            yield ("components", name, "file"), _file_digest(component.file)


def files_of_weather(case: Case) -> list[Path]:
    """Files of the weather and of the time stamps of a case that exist."""
    files = [case.path(f) for f in (case.weather.file, case.period.timestamps) if f is not None]
    return [file for file in files if file.is_file()]


def digest_of_inputs(case: Case) -> str:
    """Digest of the contents of all files that the results of a case depend on."""
    contents = {".".join(keys): content for keys, content in _contents(case)}
    told = case.colour
    tints = told.sky, told.sun, *told.spectra.values()
    spectra = [case.path(tint) for tint in tints if isinstance(tint, Path)]
    files = files_of_weather(case) + [file for file in spectra if file.is_file()]
    return _digest([contents, [*map(_file_digest, files)]])[:16]


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _file_digest(file: Path) -> str:
    return _read(file, file_numbers(file))


@lru_cache(maxsize=256)
def _read(file: Path, numbers: object) -> str:
    """Digest of a file, which every result of a run asks for; its `numbers` tell a changed one."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def settings(case: Case, daylight: Daylight) -> dict[str, Any]:
    """Origin of a result: the case as plain values, its file, its weather and its inputs."""
    return {
        "case": case.source,
        "weather_source": daylight.source,
        "inputs": digest_of_inputs(case),
        **case.model_dump(mode="json", exclude_none=True),
    }


def settings_text(case: Case, daylight: Daylight) -> str:
    """Origin of a result as JSON, an attribute of its arrays; equal texts are of one origin."""
    return json.dumps(settings(case, daylight), ensure_ascii=False)


def spaces_text(case: Case) -> str:
    """List of the spaces as JSON: name, use, storey, floor area [m²], target [lx], hours, power
    [W/m²] and groups of panes of each.
    """
    keys = ("name", "use", "storey", "floor_area", "target", "hours", "power", "groups")
    rows = [{key: getattr(space, key) for key in keys} for space in prepared(case).spaces]
    return json.dumps(rows, ensure_ascii=False)


def attributes(case: Case, daylight: Daylight, enabled_effects: EnabledEffects) -> dict[str, Any]:
    """Attributes of C: rule of the shade, place of the suns, thresholds, and the whole case."""
    return {
        "case": case.name,
        **_of_shade(case, enabled_effects),
        **{name: daylight.sky.attrs[name] for name in illuminance.SUN_OF},
        **case.metrics.model_dump(),
        "weather": daylight.source,
        "version": RELEASE,
        "method": METHOD,
        "spaces": spaces_text(case),
        "settings": settings_text(case, daylight),
        "fingerprint": fingerprint(case, enabled_effects),
        "suns": int(enabled_effects.suns),
    }


def _of_shade(case: Case, enabled_effects: EnabledEffects) -> dict[str, Any]:
    """Groups of panes with their rule and schedules."""
    groups = prepared(case).groups.states
    if not enabled_effects.shade or len(groups) == 0:
        return {"has_shade": 0}
    threshold, area = case.shade_rule
    return {
        "has_shade": 1,
        "shade_threshold": threshold,
        "shade_area": area,
        **groups.attributes(),
        **schedule_of(case.groups, groups).attributes(),
    }
