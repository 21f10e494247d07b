"""The command `drcmitsuba case`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from drcmitsuba.cli.options import CaseName, Output, Weather, load
from drcmitsuba.cli.terminal import show_notes
from drcmitsuba.runtime.errors import InputError

if TYPE_CHECKING:
    from drcmitsuba.case.case import Case
    from drcmitsuba.report.scene_view import DrawnSurfaces

LONGEST = 30
"""Largest number of letters of a pane's name in the picture."""


def case(case: CaseName, output: Output = Path(), weather: Weather = None) -> None:
    """Draw a scene before it is simulated; of a model alone, write the case file to edit."""
    import numpy as np

    from drcmitsuba.case.model import ENDINGS
    from drcmitsuba.case.model_case import (
        case_text,
        listing,
        notes_on_groups,
        views_listing,
    )
    from drcmitsuba.report import style
    from drcmitsuba.report.scene_view import scene_view
    from drcmitsuba.runtime import backend, storage
    from drcmitsuba.scene import geometry
    from drcmitsuba.scene.daylit import darkness_notes, refuse_darkness
    from drcmitsuba.scene.leaks import crack_notes, refuse_leaks
    from drcmitsuba.scene.prepared_case import prepared

    loaded = load(case, weather)
    backend.select()
    points, _ = prepared(loaded).receivers.at()
    drawn, panes = _drawn(loaded)
    of_groups = notes_on_groups(loaded.building, loaded.groups)
    remarks = (*loaded.building.notes, *of_groups, *_place_notes(loaded))
    seen = prepared(loaded).views
    arrows = {view.name: np.stack([view.position, view.direction]) for view in seen}
    figure = scene_view(
        drawn, geometry.in_file(loaded, points), title=loaded.name, names=panes, views=arrows,
        north=geometry.rotation(loaded)[1, :2],
    )  # fmt: skip
    target = output / f"{Path(case).stem}.toml"
    is_model = Path(case).suffix.lower() in ENDINGS
    if is_model and target.exists():
        remedy = "give another folder with -o; nothing is overwritten"
        raise InputError(target, "-o", "the file exists", remedy)
    output.mkdir(parents=True, exist_ok=True)
    print(f"the scene is drawn in {style.save(figure, output / 'scene.png')}")
    if loaded.building.layers:
        grids = _grids_listing(loaded)
        print("\n".join([*listing(loaded.building), *grids]))
        print(f"north: {loaded.building.north:g}°, clockwise from the model's y axis")
    for line in views_listing(seen):
        print(line)
    if is_model:
        storage.save_text(case_text(Path(case), output, loaded.building, loaded.sensors), target)
        print(f"{target}: a case to change; next: drcmitsuba evaluate {target}")
    show_notes((*remarks, *prepared(loaded).sensors.notes))
    refuse_leaks(loaded)
    refuse_darkness(loaded)
    show_notes([*crack_notes(loaded), *darkness_notes(loaded)])


def _place_notes(case: Case) -> tuple[str, ...]:
    """Remarks on the place, where the case names a weather file and another place."""
    from drcmitsuba.sky.daylight import weather_of
    from drcmitsuba.sky.remarks import place_notes

    if case.weather.file is None or (case.site is None and case.building.location is None):
        return ()
    return place_notes(case, weather_of(case).site)


def _grids_listing(case: Case) -> list[str]:
    """One line for each of the first grids of the sensors, where there are several."""
    from drcmitsuba.cli.evaluate import MOST_ROWS
    from drcmitsuba.metrics.grids import sensors_by_grid
    from drcmitsuba.runtime.errors import on_a_line
    from drcmitsuba.scene.prepared_case import prepared

    grids = sensors_by_grid(prepared(case).receivers.coordinates)
    lines = [f"grid {on_a_line(name)}: {len(sensors)} points" for name, sensors in grids.items()]
    return lines[:MOST_ROWS] + [f"{len(lines)} grids in all"] * (len(lines) > MOST_ROWS)


def _drawn(case: Case) -> tuple[list[DrawnSurfaces], list[str]]:
    """Surfaces of a case by kind in its file's frame, and a line for each material of its panes."""
    from drcmitsuba.model.model import areas, role_of
    from drcmitsuba.plan.panes import used
    from drcmitsuba.report.scene_view import DrawnSurfaces, cut
    from drcmitsuba.scene.geometry import in_file
    from drcmitsuba.scene.sun_visibility import outside
    from drcmitsuba.scene.surfaces import surfaces_of

    context = {piece.name for piece in outside(case)} if case.room is not None else set()
    context |= {layer.name for layer in case.building.layers if layer.role == "context"}
    by_group, size = _panes_by_group(case), dict[str, float]()
    drawn, grouped = [], {quad.tobytes() for panes in by_group for quad in panes.quads}
    for surface in surfaces_of(case):
        is_pane, quads = (
            role_of(surface.material) == "pane" and not surface.component,
            surface.quads,
        )
        kind = "context" if surface.name in context else "pane" if is_pane else "surface"
        if kind == "pane":
            name = _name(case, surface.name)
            size[name] = size.get(name, 0.0) + float(areas(quads).sum())
            quads = quads[[quad.tobytes() not in grouped for quad in quads]]
        drawn.append(DrawnSurfaces(kind, quads))
    sides = used(case)
    rows = ((cut(n, LONGEST), a, ", ".join(sides.get(n, ()))) for n, a in size.items())
    panes = [f"{name}: {area:.2f} m², {facings}" for name, area, facings in rows]
    placed = [one._replace(quads=in_file(case, one.quads)) for one in (*drawn, *by_group)]
    return placed, panes


def _panes_by_group(case: Case) -> list[DrawnSurfaces]:
    """Panes of the groups, where there are several or with several states."""
    import numpy as np

    from drcmitsuba.case.groups import OTHERS
    from drcmitsuba.model.model import areas
    from drcmitsuba.report.scene_view import DrawnSurfaces
    from drcmitsuba.scene.panes_in_state import grouped_panes
    from drcmitsuba.scene.prepared_case import prepared

    groups, every = prepared(case).groups, grouped_panes(case)
    if len(groups) < 2 and not case.groups:
        return []
    drawn = []
    names = zip(groups.states.names, groups.states.states, strict=True)
    for g, (name, states) in enumerate(names):
        mine = [panes.quads for panes in every if panes.group == g]
        quads = np.concatenate([np.zeros((0, 4, 3)), *mine])
        line = f"{name}: {areas(quads).sum():.2f} m², {', '.join(states)}"
        drawn += [DrawnSurfaces("pane", quads, line)] * (name != OTHERS)
    return drawn


def _name(case: Case, surface: str) -> str:
    """Name of a pane's material; surfaces of a room's façades also name their side."""
    return surface if surface in case.materials else surface.rpartition(" ")[0]
