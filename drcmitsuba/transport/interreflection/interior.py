"""Paths among the surfaces of a room: they are the same in all states that look alike from within.

A pane that reflects nothing ends every path, whatever it lets in. The states of a façade of such
panes share the paths of the sensors, the cells, the points that stand for them, and T.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.runtime.launch_size import PATHS, SENSORS
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.interreflection.solved_cells import Transfer, solved


class RoomPaths(NamedTuple):
    """Paths among the surfaces of a scene; they know no light."""

    gathered: Gathered
    transfer: Transfer | None
    """T, where light between surfaces is solved on cells."""

    @classmethod
    def of(
        cls, scene: Scene, points: np.ndarray, normals: np.ndarray, accuracy: Accuracy,
        rooms: np.ndarray | None = None,
    ) -> RoomPaths:  # fmt: skip
        """Trace the paths from points (sensor, 3) [m] with their unit normals, and T.

        `rooms` are as for `Gathered.of`.
        """
        once = scene.effects.solved_cells
        gathered = Gathered.of(
            scene, points, normals, accuracy, block=SENSORS, lanes=PATHS, once=once, rooms=rooms
        )
        if not (once and gathered.cells.count):
            return cls(gathered, None)
        return cls(*solved(scene, gathered, accuracy))


@dataclass
class SharedInterior:
    """The latest interior, which is traced once for scenes that look alike from within."""

    _seen: tuple[Any, ...] = ()
    """Everything that it depends on."""
    _latest: RoomPaths | None = None

    def of(
        self, scene: Scene, points: np.ndarray, normals: np.ndarray, accuracy: Accuracy,
        rooms: np.ndarray | None = None,
    ) -> RoomPaths:  # fmt: skip
        """Interior of a scene, as `RoomPaths.of`; paths that were not stored are traced anew."""
        seen = scene.from_within, points, normals, accuracy.sampling, rooms
        if self._latest is None or content_key(*self._seen) != content_key(*seen):
            self._seen, self._latest = (), None  # two of them would need twice the memory
            interior = RoomPaths.of(scene, points, normals, accuracy, rooms)
            if not interior.gathered.is_stored:
                return interior
            self._seen, self._latest = seen, interior
        return self._latest

    def forget(self) -> None:
        """Give back the memory."""
        self._seen, self._latest = (), None
