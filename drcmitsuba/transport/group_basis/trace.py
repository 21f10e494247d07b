"""Light of every element in a case, one independent replicate after another.

case ─ grouped_panes ─► panes by group, with their materials in every state
     ─ GroupMarks ────► paths G₀ and G_m, one set for all states
     ─ elements ──────► S, D of every element, the other groups blocked; less S₀, D₀, all blocked

The random numbers of all deposits are the same, so that light that passes no grouped pane cancels.
Light that passes two grouped panes in turn before any diffuse reflection, as through a corner of
two façades, is left out; so is light that clear glass mirrors from pane to pane.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import HIDDEN, GroupStates
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.random_streams import Stream, launch_seed, number_in_replicate
from drcmitsuba.runtime.toml import shortened
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import origin
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import grouped_panes, groups_with_surfaces
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.deposit import Irradiance
from drcmitsuba.transport.gather_blocks import Gathered
from drcmitsuba.transport.group_basis.elements import Element, elements_of_case
from drcmitsuba.transport.group_basis.marks import MOST_ELEMENTS, GroupMarks
from drcmitsuba.transport.launch_size import PATHS, SENSORS
from drcmitsuba.transport.marked_paths import MarkedPaths
from drcmitsuba.transport.replicate import Replicates
from drcmitsuba.transport.straight_suns import sensor_numbers


class ElementDeposit(NamedTuple):
    """Light of an element in one replicate, less what passes no grouped pane."""

    number: int
    """Number of the element, or `BESIDES`."""
    bins: np.ndarray
    """Its bins among the labels, int, shape (own bin,): ground and all sky patches, some suns."""
    sensors: np.ndarray
    """S: D of the sensors [sr], shape (sensor, own bin)."""
    cells: Irradiance
    """D of the cells [sr]."""

    def less(self, besides: ElementDeposit) -> ElementDeposit:
        """Light without that which passes no grouped pane; it has all bins of this element."""
        at, (sky, sun) = np.searchsorted(besides.bins, self.bins), self.cells
        suns = flat_indices(at[sky.shape[1] :] - sky.shape[1])
        cells = Irradiance(sky - besides.cells.sky, sun - _columns(besides.cells.sun, suns))
        return self._replace(sensors=self.sensors - besides.sensors[:, at], cells=cells)


@dataclass(frozen=True)
class GroupTrace:
    """Paths of all sensors, and the elements whose light they gather."""

    groups: GroupStates
    points: np.ndarray
    """Sensors, and their normals, as `scene.sensors.sensor_points` gives them."""
    normals: np.ndarray
    positions: np.ndarray
    """Positions of the sensors in the case's frame [m], shape (sensor, 3)."""
    labels: tuple[str, ...]
    """Bins: ground, sky patches, suns."""
    sky_bins: int
    """Number of bins of ground and sky, which come first."""
    accuracy: Accuracy
    paths: MarkedPaths
    elements: tuple[Element, ...]
    """Elements, the light that passes no grouped pane first."""

    @classmethod
    def of(
        cls, case: Case, suns: Suns, accuracy: Accuracy, effects: EnabledEffects, *,
        channel: int = -1, wanted: Mapping[int, np.ndarray] | None = None,
        sensors: slice = slice(None),
    ) -> GroupTrace:  # fmt: skip
        """Trace the paths, and load the scene of every element.

        Parameters
        ----------
        case : Case
        suns : Suns
        accuracy : Accuracy
        effects : EnabledEffects
            Effects that are simulated; light from pane to pane is not, beside what diffusing panes
            and films reflect, as if it came from all directions alike.
        channel : int
            Colour channel, −1 for luminance.
        wanted : mapping of int to np.ndarray of bool, shape (sun,), optional
            Suns of each element that is asked for; by default all suns of all elements.
        sensors : slice
            Sensors of the case; by default all.

        Raises
        ------
        InputError
            The case has no groups, or too many states, or states that no sum can hold.
        """
        case = case.without_polish()
        _refuse(case)
        effects = replace(effects, pane_to_pane=False)
        groups, panes = PaneGroups.of(case).states, grouped_panes(case, effects)
        if not panes:
            got, remedy = "there is none", "add [groups] or [shading]"
            raise InputError(case.source, "groups", got, remedy)
        if groups.starts[-1] > MOST_ELEMENTS:
            got = f"{groups.starts[-1]} states of all groups"
            raise InputError(case.source, "groups", got, f"take at most {MOST_ELEMENTS} together")
        points, normals = (each[sensors] for each in sensor_points(case))
        hidden = scene.load(case, groups.label([HIDDEN] * len(groups)), channel, effects)
        marks = GroupMarks(panes, np.array(groups.starts), channel, effects.beyond)
        shapes = {f"shape{i}": shape for i, shape in enumerate((*hidden.full.shapes(), marks.mesh))}
        corners = np.concatenate([hidden.corners, *(each.quads.reshape(-1, 3) for each in panes)])
        full = mi.load_dict({"type": "scene", **shapes}, optimize=False)
        world = hidden.searched(full=full, corners=corners)
        gathered = Gathered.of(
            world, points, normals, accuracy, block=SENSORS, lanes=PATHS, marks=marks
        )
        labels = (*Patches(case.sky.subdivision).labels, *suns.labels)
        elements = elements_of_case(
            case, panes, groups, suns, points, normals, accuracy, effects, channel, wanted
        )
        return cls(
            groups, points, normals, points + origin(case), labels, len(labels) - len(suns.labels),
            accuracy, MarkedPaths(gathered, len(points)), tuple(elements),
        )  # fmt: skip

    def light(self, replicate: int) -> Iterator[ElementDeposit]:
        """Yield the light of every element in a replicate, `BESIDES` first."""
        besides = self._deposit(self.elements[0], replicate)
        yield besides
        dark = not besides.sensors.any() and not besides.cells.numpy().any()
        for element in self.elements[1:]:
            own = self._deposit(element, replicate)
            yield own if dark else own.less(besides)

    def _deposit(self, element: Element, r: int) -> ElementDeposit:
        """All light in the scene of an element."""
        lit, gathered = element.deposit.lit(r), self.paths.gathered
        replicate, landed = Replicates.one(r, lit), None
        if element.photons is not None:
            seed = launch_seed(self.accuracy.seed, Stream.PHOTONS, r)
            landed = element.photons.traced(seed, lambda share: None)
            replicate.landed = (landed,)
        cells = Irradiance(*(dr.zeros(mi.TensorXf, (0, n)) for n in element.deposit.bins))
        if gathered.cells.count:
            replicate.meet(gathered.drawn.apart()[r], gathered.cells.keys)
            replicate.join()
            assert replicate.cells is not None
            cells = replicate.cells
        sensors = np.empty((len(self.points), len(element.bins)), np.float32)
        for here in gathered.blocks:
            p, n = flat(self.points[here]), flat(self.normals[here])
            within = None if gathered.within is None else mi.Bool(gathered.within[here])
            key, numbers = (Stream.SENSORS,), number_in_replicate(sensor_numbers(here), r)
            rays, samples = self.accuracy.sensor_sky_rays, self.accuracy.sensor_sun_samples
            straight = lit.straight(p, n, key, rays, samples, numbers, within)
            sensors[here] = straight.plus(lit.scattered(p, n, key, numbers)).numpy()
            if landed is not None:
                sensors[here] += landed.sensors(here).numpy()
        return ElementDeposit(element.number, element.bins, sensors, cells)


def _columns(values: mi.TensorXf, at: mi.UInt32) -> mi.TensorXf:
    """Some columns of a matrix."""
    rows, columns = values.shape[0], dr.width(at)
    if rows * columns == 0:
        return dr.zeros(mi.TensorXf, (rows, columns))
    few, many = (dr.opaque(mi.UInt32, n) for n in (columns, values.shape[1]))
    entry = dr.arange(mi.UInt32, rows * columns)
    column = dr.gather(mi.UInt32, at, entry % few)
    return mi.TensorXf(
        dr.gather(mi.Float, values.array, entry // few * many + column), (rows, columns)
    )


def _refuse(case: Case) -> None:
    """Refuse components, and groups of a model whose states change more than panes."""
    remedy = "take fewer states, which are simulated one by one"
    if case.standing:
        got = f"a sum over groups of panes counts no light by way of {shortened(case.standing[0])}"
        raise InputError(case.source, "components", got, remedy)
    for group in groups_with_surfaces(case)[:1]:
        got = "its states have surfaces of their own"
        raise InputError(case.source, f"groups.{group}", got, remedy)
