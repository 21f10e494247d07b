"""Light of every element in a case before any diffuse reflection, and the paths that gather it.

case, openings ─ grouped_panes ─► panes by opening, with their material in every fill
     ─ OpeningMarks ────────────► paths G₀ and G_m, one set for all fills
     ─ elements_of_case ────────► S, D of every element, the other openings blocked; less S₀, D₀
     ─ elements_of_pairs ───────► S, D of every pair whose panes mirror from one to the other

The random numbers of all deposits are the same, so that light that passes no opening cancels.
Light that passes two openings in turn before any diffuse reflection, as through a corner of two
façades, is left out. What the glass of one element mirrors of the light of another is a pair's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import HIDDEN, GroupStates
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.launch_size import PATHS, SENSORS
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import origin
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import grouped_panes, refuse_surfaces
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.scene import Scene
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.elements.light_on_receivers import LightOnReceivers
from drcmitsuba.transport.elements.marks import MOST_ELEMENTS, OpeningMarks
from drcmitsuba.transport.elements.mirrored_pairs import MirroredPairs
from drcmitsuba.transport.elements.paths import ElementPaths, FollowedPaths, OutsideRooms
from drcmitsuba.transport.elements.scenes import Element, elements_of_case, elements_of_pairs
from drcmitsuba.transport.elements.solved_paths import SolvedPaths
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.interreflection.solved_cells import solved
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.rays.openings import Within, within_of
from drcmitsuba.transport.rays.straight_suns import Disks, sensor_numbers
from drcmitsuba.transport.replicate import Replicates

Points = tuple[np.ndarray, np.ndarray]
"""Positions and normals of receivers, shape (sensor, 3) each."""
MOST_PAIRS = 1 << 28
"""Largest number of pairs of a sensor and a cell that a matrix holds; beyond it, paths are kept."""
KEPT = 1 << 26
"""Largest number of pairs of sensors and suns whose disks are kept for further replicates."""


class SensorLight(NamedTuple):
    """Light of an element on some sensors."""

    here: slice
    straight: LightOnReceivers
    """S by straight light."""
    direct: LightOnReceivers
    """S by all light."""

    def less(self, other: SensorLight, suns: np.ndarray) -> SensorLight:
        """Subtract other light, as `LightOnReceivers.less`."""
        straight = self.straight.less(other.straight, suns)
        return SensorLight(self.here, straight, self.direct.less(other.direct, suns))


class ElementDeposit(NamedTuple):
    """Light of an element in some replicates, before any diffuse reflection."""

    sensors: tuple[SensorLight, ...]
    """S of the sensors, some of them after the others."""
    cells: LightOnReceivers
    """D of the cells."""

    def less(self, other: ElementDeposit, own: np.ndarray, bins: np.ndarray) -> ElementDeposit:
        """Subtract light that has all `bins` of this one among its `own`."""
        sky = self.cells.apart.sky.shape[1]
        suns = np.searchsorted(own, bins)[sky:] - sky
        pairs = zip(self.sensors, other.sensors, strict=True)
        sensors = tuple(mine.less(theirs, suns) for mine, theirs in pairs)
        return ElementDeposit(sensors, self.cells.less(other.cells, suns))

    @property
    def is_dark(self) -> bool:
        """Whether there is no light at all."""
        return all(each.is_dark for each in (self.cells, *(of.direct for of in self.sensors)))


@dataclass(frozen=True)
class ElementTrace:
    """Paths of all sensors, and the elements whose light they gather."""

    openings: GroupStates
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
    paths: ElementPaths
    besides: Element
    """Light that passes no opening."""
    elements: tuple[Element, ...]
    """Every opening with every fill, then `pairs`."""
    pairs: MirroredPairs
    _disks: dict[tuple[int, int], Disks] = field(default_factory=dict, init=False, repr=False)
    """Disks of suns that were looked for, by element and first sensor."""

    @classmethod
    def of(
        cls, case: Case, openings: PaneGroups, suns: Suns, accuracy: Accuracy,
        effects: EnabledEffects, *, channel: int = -1, draws: int = 1,
        wanted: Mapping[int, np.ndarray] | None = None, receivers: Points | None = None,
    ) -> ElementTrace:  # fmt: skip
        """Trace the paths, and load the scene of every element.

        Parameters
        ----------
        case : Case
        openings : PaneGroups
            Openings and their fills, from `scene.fills.openings_of`, or groups of the case.
        suns : Suns
        accuracy : Accuracy
        effects : EnabledEffects
            Effects that are simulated; of light from pane to pane, what clear glass mirrors, and
            what diffusing panes and films reflect, as if it came from all directions alike.
        channel : int
            Colour channel, −1 for luminance.
        draws : int
            Number of replicates whose paths are averaged into one result.
        wanted : mapping of int to np.ndarray of bool, shape (sun,), optional
            Suns of each element that is asked for; by default all suns of all elements.
        receivers : tuple of np.ndarray, shape (sensor, 3), optional
            Positions [m] and unit normals in the traced frame, as from `Receivers.at`; by default
            those of all sensors of the case.

        Raises
        ------
        InputError
            The case has no openings, or too many fills, or fills that no sum can hold.
        """
        case = case.without_polish()
        if not openings.standing:
            refuse_surfaces(case)
        in_panes, effects = effects.pane_to_pane, replace(effects, pane_to_pane=False)
        groups, panes = openings.states, grouped_panes(case, effects, openings)
        if not panes:
            got, remedy = "there is none", "add [groups] or [shading]"
            raise InputError(case.source, "groups", got, remedy)
        if groups.starts[-1] > MOST_ELEMENTS:
            got = f"{groups.starts[-1]} fills of all openings"
            remedy = f"take at most {MOST_ELEMENTS} together: fewer tiles, groups or materials"
            raise InputError(case.source, "openings", got, remedy)
        points, normals = prepared(case).receivers.at() if receivers is None else receivers
        label = groups.label([HIDDEN] * len(groups))
        hidden = scene.load(case, label, channel, effects, openings)
        marks = OpeningMarks(panes, np.array(groups.starts), channel)
        world = marks.placed_in(hidden.searched())
        paths = _paths_of(
            world, points, normals, accuracy, marks, draws, on_cells=effects.solved_cells
        )
        labels = (*Patches(case.sky.subdivision).labels, *suns.labels)
        besides, *elements = elements_of_case(
            case, openings, panes, suns, points, normals, accuracy, effects, channel, wanted
        )
        pairs = MirroredPairs.of(panes, groups.starts) if in_panes else MirroredPairs()
        elements += elements_of_pairs(pairs, elements, panes, groups.starts, wanted)
        return cls(
            groups, points, normals, points + origin(case), labels, len(labels) - len(suns.labels),
            accuracy, paths, besides, tuple(elements), pairs,
        )  # fmt: skip

    def with_pairs(self, most: int) -> ElementTrace:
        """Trace with at most so many of the pairs."""
        first, kept = self.openings.starts[-1], self.pairs.largest(most)
        numbers = {first + k: first + i for i, k in enumerate(kept)}
        elements = [each for each in self.elements if each.number < first]
        elements += [
            replace(each, number=numbers[each.number])
            for each in self.elements
            if each.number in numbers
        ]
        return replace(self, elements=tuple(elements), pairs=self.pairs.at(kept))

    def beside(self, replicates: range) -> ElementDeposit | None:
        """Light that passes no opening in some replicates; None where there is none."""
        light = self.deposited(self.besides, replicates)
        return None if light.is_dark else light

    def deposited(
        self, element: Element, replicates: range, besides: ElementDeposit | None = None
    ) -> ElementDeposit:
        """Light of an element in some replicates, less what passes no opening."""
        own = self._deposited(element, replicates)
        if besides is None or element.is_mirrored:
            return own
        return own.less(besides, self.besides.bins, element.bins)

    def _deposited(self, element: Element, numbers: range) -> ElementDeposit:
        """All light in the scene of an element."""
        gathered, light = self.paths.gathered, element.deposit
        assert light is not None
        every = Replicates(numbers, tuple(light.lit(r) for r in numbers))
        if element.photons is not None:
            seeds = (launch_seed(self.accuracy.seed, Stream.PHOTONS, r) for r in numbers)
            every.landed = tuple(element.photons.traced(seed) for seed in seeds)
        every.cells = Irradiance(*(dr.zeros(mi.TensorXf, (0, n)) for n in light.bins))
        if gathered.cells.count:
            drawn = gathered.drawn.of(numbers)
            within = within_of(light.scene, drawn.p.numpy().reshape(-1, 3))
            every.meet(drawn, gathered.cells.keys, within)
        panes = tuple((each.cells, each.light) for each in every.panes)
        count, sensors = len(numbers), []
        for here in gathered.blocks:
            p, n = flat(self.points[here]), flat(self.normals[here])
            told = None if gathered.within is None else gathered.within[here]
            within = within_of(light.scene, self.points[here], told)
            disks = self._disks_of(element.number, light, here, p, n, within)
            straight, direct, parts = every.sensors_by_parts(
                p, n, here, element.sun_samples, within, disks
            )
            dr.eval(straight, direct)
            each = LightOnReceivers(count, straight), LightOnReceivers(count, direct, tuple(parts))
            sensors.append(SensorLight(here, *each))
        return ElementDeposit(tuple(sensors), LightOnReceivers(count, every.cells, panes))

    def _disks_of(
        self, element: int, light: Deposit, here: slice, p: mi.Float, n: mi.Float, within: Within
    ) -> Disks:
        """Disks of the suns as sensors see them in the scene of an element, by its number."""
        key = element, here.start
        if (disks := self._disks.get(key)) is None:
            disks = light.disks(p, n, sensor_numbers(here), within)
            suns = sum(e.deposit.bins[1] for e in self.elements if e.deposit is not None)
            if suns * len(self.points) <= KEPT:
                self._disks[key] = disks
        return disks


def _paths_of(
    world: Scene, points: np.ndarray, normals: np.ndarray, accuracy: Accuracy,
    marks: OpeningMarks, draws: int, *, on_cells: bool,
) -> ElementPaths:  # fmt: skip
    """Trace the paths of sensors.

    Parameters
    ----------
    world : Scene
        Scene with the openings, whose fill `marks` draws.
    points, normals : np.ndarray, shape (sensor, 3)
        Positions [m] and unit normals.
    draws : int
        Number of replicates whose paths are averaged into one result.
    on_cells : bool
        Whether light between surfaces may be solved on cells.
    """
    if on_cells:
        ending = marks.ending()
        gathered = Gathered.of(
            world, points, normals, accuracy, block=SENSORS, lanes=PATHS, marks=ending, once=True
        )
        if gathered.cells.count:
            gathered, transfer = solved(world, gathered, accuracy, ending)
            if gathered.cells.count * len(points) <= MOST_PAIRS:
                outside = OutsideRooms.of(world, points, gathered)
                return SolvedPaths(gathered, transfer, outside, accuracy.paths, draws)
    gathered = Gathered.of(
        world, points, normals, accuracy, block=SENSORS, lanes=PATHS, marks=marks
    )
    outside = OutsideRooms.of(world, points, gathered)
    return FollowedPaths(gathered, outside, accuracy.replicates // draws, draws)
