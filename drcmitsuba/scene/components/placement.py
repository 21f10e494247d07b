"""All components of a case in position, checked against each other and against the room."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.components import Duct, LightPipe, MeshComponent, StructureComponent
from drcmitsuba.case.facade import Facade
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components.duct import duct
from drcmitsuba.scene.components.lightpipe import lightpipe
from drcmitsuba.scene.components.mesh import is_solid, mesh, triangles
from drcmitsuba.scene.components.of_model import of_model
from drcmitsuba.scene.components.placed_component import PlacedComponent, check_hole
from drcmitsuba.scene.components.structure import structure
from drcmitsuba.scene.geometry import SIDES, Port, boxes, normals, overhead, quad, wall
from drcmitsuba.scene.structures.solid import winding

NEAR = 1e-6
"""Distance below which a point lies in a wall's plane [m]."""
MARGIN = 1e-6
"""Distance beyond an opening's edge at which a point still lies in it, as a share of the edge."""
IN_A_WALL = "it lies in a wall", "move it into an opening"
TURNED = "it turns its back on every opening", "give its corners in the other order"
DARK = (IN_A_WALL, TURNED)
"""Faults, with their remedies, of ports that no light reaches."""


def place(case: Case) -> tuple[PlacedComponent, ...]:
    """Build the components of a case in the room's frame; structures need a strip that names them.

    Mirrors and clear solids of a model are components, too.

    Raises
    ------
    InputError
        A component is unfit, its hole leaves the ceiling, or it runs into another one; or a port
        lies in a wall or a solid, or faces no opening.
    """
    panes = panes_of(case)
    placed_components = []
    for name, component in case.components.items():
        if isinstance(component, StructureComponent):
            if name in panes:
                placed_components.append(structure(case, name, component, panes[name]))
        elif isinstance(component, LightPipe):
            placed_components.append(lightpipe(case, name, component))
        elif isinstance(component, Duct):
            placed_components.append(duct(case, name, component))
        else:
            placed_components.append(mesh(case, name, component))
    if case.room is not None:
        for placed in placed_components:
            check_hole(case.source, placed, case.room.size)
    _check_apart(case.source, [placed for placed in placed_components if placed.hole is not None])
    return (*_checked_ports(case, placed_components), *of_model(case))


def panes_of(case: Case) -> dict[str, list[np.ndarray]]:
    """Panes and holes (4, 3) [m] of all façades by material or component, fronts inward."""
    by_name: dict[str, list[np.ndarray]] = {}
    if case.room is not None:
        for side in SIDES:
            for name, panes in wall(case.room, side, case.facade.get(side, Facade()))[2].items():
                by_name.setdefault(name, []).extend(panes)
    return by_name


def _check_apart(source: str, above: list[PlacedComponent]) -> None:
    """Refuse components above the ceiling whose bounds overlap."""
    for a, b in combinations(above, 2):
        (low, high), (other_low, other_high) = a.bounds, b.bounds
        if ((low < other_high) & (other_low < high)).all():
            got, remedy = f"it runs into {a.name}", "move one of them"
            raise InputError(source, f"components.{b.name}", got, remedy)


def _solids(case: Case) -> Iterator[tuple[str, np.ndarray]]:
    """Closed meshes among the components: names and triangles (triangle, 3, 3)."""
    for name, component in case.components.items():
        if isinstance(component, MeshComponent) and is_solid(component):
            yield name, triangles(component)


def inside(case: Case, points: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Names of a case's closed meshes, each with a mask of the points (point, 3) that lie in it."""
    return _within(_solids(case), points)


def _within(
    solids: Iterable[tuple[str, np.ndarray]], points: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Names of solids, each with a mask of the points (point, 3) in it; normals do not matter."""
    for name, corners in solids:
        faces, vertices = np.arange(3 * len(corners)).reshape(-1, 3), corners.reshape(-1, 3)
        within = ((points >= vertices.min(axis=0)) & (points <= vertices.max(axis=0))).all(axis=1)
        if within.any():
            within[within] = abs(winding(vertices, faces, points[within])) > 0.5
        yield name, within


def _checked_ports(
    case: Case, placed_components: list[PlacedComponent]
) -> Iterator[PlacedComponent]:
    """Components with ports that light can reach.

    Every port from the case file, a light pipe, a duct or a structure has to be fit. A mesh without
    own ports keeps the fit faces of its bounding box, at least one; a face in the plane of openings
    gives way to its parts in them.
    """
    openings, solids = _openings(case, placed_components), list(_solids(case))
    for placed in placed_components:
        component = case.components[placed.name]
        by_box = isinstance(component, MeshComponent) and not component.ports
        if by_box:
            quads = (_parts_in_openings(port.quad, openings) for port in placed.ports)
            ports = tuple(Port(placed.name, part) for parts in quads for part in parts)
            placed = replace(placed, ports=ports)
        faults = [_fault(case, port.quad, openings, solids) for port in placed.ports]
        if by_box:  # a face partly in a solid stays a port
            faults = [fault if fault in DARK else None for fault in faults]
        for i, fault in enumerate(faults):
            if fault is not None and (not by_box or None not in faults):
                raise InputError(case.source, f"components.{placed.name}.ports.{i}", *fault)
        fit = tuple(p for p, fault in zip(placed.ports, faults, strict=True) if fault is None)
        yield replace(placed, ports=fit)


def _openings(case: Case, placed_components: list[PlacedComponent]) -> np.ndarray:
    """Rectangles (opening, 4, 3) by which light enters the room."""
    quads = [q for panes in panes_of(case).values() for q in panes]
    for placed in placed_components:
        if placed.hole is not None and case.room is not None:
            quads.append(overhead(placed.hole, case.room.size[2]))
    return np.reshape(quads, (-1, 4, 3))


def _fault(
    case: Case, q: np.ndarray, openings: np.ndarray, solids: list[tuple[str, np.ndarray]]
) -> tuple[str, str] | None:
    """Fault of a port (4, 3) and its remedy; None for a fit port."""
    middle = q.mean(axis=0)
    points = np.concatenate([middle[None], middle + 0.98 * (q - middle)])
    for piece in case.furniture:
        for corner, size in boxes(piece):
            within = (points > corner + NEAR) & (points < corner + size - NEAR)
            if within.all(axis=1).any():
                return f"it lies in {piece.name!r}", "move one of them"
    for name, within in _within(solids, points):
        if within.any():
            return f"it lies inside of {name}", "move it into the air"
    if case.room is None:
        return None
    size = np.array(case.room.size)
    indoors = ((points > NEAR) & (points < size - NEAR)).all(axis=1)
    outdoors = ((points < -NEAR) | (points > size + NEAR)).any(axis=1)
    if indoors.any() and outdoors.any():
        return "it goes through a wall", "keep it on one side, or in the plane of an opening"
    if not indoors.any() and not outdoors.any() and not _in_an_opening(points, openings):
        return IN_A_WALL
    if indoors.all() and len(openings):
        behind = (openings.reshape(-1, 3) - middle) @ normals(q[None])[0]
        if behind.min() >= 0:
            return TURNED
    return None


def _in_an_opening(points: np.ndarray, openings: np.ndarray) -> bool:
    """Whether each point (point, 3) lies in one of the rectangles (opening, 4, 3)."""
    there, s, t = _places(points, openings)
    for at in (s, t):
        there &= (at > -MARGIN) & (at < 1 + MARGIN)
    return bool(there.any(axis=1).all())


def _parts_in_openings(q: np.ndarray, openings: np.ndarray) -> list[np.ndarray]:
    """Parts of a rectangle (4, 3) in openings of its plane, along whose edges its own ones lie.

    A rectangle that meets no opening is whole.
    """
    parts, (there, *places) = list[np.ndarray](), _places(q, openings)
    for i in np.flatnonzero(there.all(axis=0)):
        a, b = (np.clip([at[:, i].min(), at[:, i].max()], 0, 1) for at in places)
        if min(*np.diff(a), *np.diff(b)) <= MARGIN:
            continue
        corner, along, _, up = openings[i]
        u, v = along - corner, up - corner
        part = quad(corner + a[0] * u + b[0] * v, np.diff(a) * u, np.diff(b) * v)
        parts.append(part if normals(part[None])[0] @ normals(q[None])[0] > 0 else part[::-1])
    return parts or [q]


def _places(points: np.ndarray, openings: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whether points (point, 3) lie in the planes of openings, and where along their two edges.

    The arrays have the shape (point, opening); the places are 0 to 1 within an opening.
    """
    u, v = openings[:, 1] - openings[:, 0], openings[:, 3] - openings[:, 0]
    from_corner = points[:, None] - openings[None, :, 0]
    across = np.einsum("poi,oi->po", from_corner, normals(openings)) if len(openings) else 0.0
    s, t = (np.einsum("poi,oi->po", from_corner, e) / (e * e).sum(axis=1) for e in (u, v))
    return np.broadcast_to(abs(across) < NEAR, s.shape).copy(), s, t
