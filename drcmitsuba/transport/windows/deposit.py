r"""Deposit D by the window through which light comes in.

Straight light is traced once more for each window that is blocked in turn, with the same random
numbers: what the k-th blocked window takes away came through it,

.. math:: D_k = D(\text{0 … k−1 blocked}) - D(\text{0 … k blocked}),

so that the parts add up to D. Light that passes two windows in turn counts with the first of the
list. Light that a pane scatters on its way in counts with the window of this pane. What a diffusing
pane reflects into the room counts with the window that the light came in by. What a film reflects
counts with the film.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.random_streams import Draw, Key, Stream
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.meshes import paired_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.panes.patches import PanePatches
from drcmitsuba.transport.panes.transfer import neumann_series

Straight = Callable[[Deposit], Irradiance]
"""Computes straight light of a deposit on some receivers."""
ON_PANE = 1e-3
"""Distance within which a patch lies on the pane of a window [m]."""
BEFORE = 0.05
"""Distance before its origin at which a ray begins that is tested for a pane it has passed [m]."""


class WindowPanes(NamedTuple):
    """Panes or openings that count together."""

    name: str
    quads: np.ndarray
    """Corners [m], shape (quad, 4, 3)."""


class Windows:
    """Windows of a scene; `gather.paths.Crossings` of the paths that leave it by them."""

    def __init__(self, windows: Sequence[WindowPanes]) -> None:
        self.windows = tuple(windows)
        if not windows:
            return
        quads = np.concatenate([window.quads for window in windows])
        of_quad = np.repeat(np.arange(len(windows)), [len(window.quads) for window in windows])
        self.of_quad, self._inward = flat_indices(of_quad), flat(normals(quads))
        self._scene = mitsuba_scene({"windows": paired_mesh("windows", quads)})

    def __len__(self) -> int:
        """Count the windows."""
        return len(self.windows)

    def met(self, ray: mi.Ray3f, active: mi.Bool) -> tuple[mi.Bool, mi.UInt32]:
        """Whether rays meet a window, and its quad."""
        hit = self._scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        return active & hit.is_valid(), hit.prim_index // 2

    def left_at(self, ray: mi.Ray3f) -> tuple[np.ndarray, np.ndarray]:
        """Whether rays leave by a window, bool (ray,), and at which distance [m]."""
        hit = self._scene.ray_intersect_preliminary(ray, coherent=False)
        inward = dr.gather(mi.Vector3f, self._inward, hit.prim_index // 2, hit.is_valid())
        leaves = hit.is_valid() & (dr.dot(inward, ray.d) < 0)
        return leaves.numpy(), dr.select(leaves, hit.t, dr.inf).numpy()

    def mark(self, ray: mi.Ray3f, t: mi.Float, mark: mi.UInt32, active: mi.Bool) -> mi.UInt32:
        """Mark paths with 1 + the window by which they leave; see `gather.paths.Crossings`.

        A ray begins beyond the pane that it has just passed, and is tested from before it. At a
        pane that it meets it may be mirrored.
        """
        whole = mi.Ray3f(ray.o - BEFORE * ray.d, ray.d, t * (1 - 1e-4) + BEFORE - 1e-4, 0, [])
        met, quad = self.met(whole, active & (mark == 0))
        leaves = met & (dr.dot(dr.gather(mi.Vector3f, self._inward, quad, met), ray.d) < 0)
        return dr.select(leaves, dr.gather(mi.UInt32, self.of_quad, quad, leaves) + 1, mark)


@dataclass(frozen=True, eq=False)
class WindowDeposit:
    """Deposit on any receivers by window."""

    blocked: tuple[Scene, ...]
    """Scenes with the first, the first two, … windows blocked to straight light."""
    of_diffuser: np.ndarray | None
    """Window of every patch of diffusing panes, `len(blocked)` for none, int, shape (patch,)."""
    of_film: np.ndarray | None
    """Window of every patch of films, likewise."""

    @classmethod
    def of(cls, deposit: Deposit, windows: Windows) -> WindowDeposit:
        """Block the windows of a deposit's scene, and assign the patches of its panes to them."""
        scene, shut, blocked = deposit.scene, dict[str, mi.Shape](), []
        for i, window in enumerate(windows.windows):
            shut[f"window{i}"] = paired_mesh(f"window{i}", window.quads)
            opaque, occluders = (_with(s, shut) for s in (scene.opaque, scene.occluders))
            blocked.append(replace(scene, opaque=opaque, occluders=occluders))
        diffusers, films = deposit.patches, deposit.films
        of_diffuser = None if diffusers is None else _windows_of(diffusers, windows)
        of_film = None if films is None else _windows_of(films.patches, windows)
        return cls(tuple(blocked), of_diffuser, of_film)

    def __len__(self) -> int:
        """Count the parts: the windows, and last what comes by none of them."""
        return len(self.blocked) + 1

    def on_diffusers(self, deposit: Deposit, replicate: int) -> list[Irradiance]:
        """E on the faces of diffusing panes by window [sr], whose sum is `Deposit.faces`.

        Light on the outside of a pane comes in by this pane.
        """
        if deposit.patches is None or self.of_diffuser is None:
            return []
        key: Key = (Stream.PANES, replicate)
        points = np.random.default_rng(deposit.seed(key, Draw.POINTS))
        p, n = deposit.patches.face_points(points)
        straight = self._parted(deposit, lambda one: one.onto_panes(p, n, key))
        by_films: Key = (Stream.FILMS_TO_PANES, replicate)
        received = [
            part.plus(self._by_films(deposit, p, n, by_films, None, k))
            for k, part in enumerate(straight)
        ]
        whole, between = reduce(Irradiance.plus, received), deposit.transfer(p, n, key)
        outside = np.arange(2 * len(deposit.patches)) % 2 == 1
        lit = []
        for k, part in enumerate(received):
            own = _column(outside & (self.of_diffuser.repeat(2) == k))
            inside = _column(~outside)
            first = (  # without a sun that meets panes there is none to scale
                inside * E + own * every if E.shape[1] else E
                for E, every in zip(part, whole, strict=True)
            )
            lit.append(Irradiance(*(neumann_series(between, E) for E in first)))
        return lit

    def parts(
        self, deposit: Deposit, on_diffusers: list[Irradiance], p: mi.Float, n: mi.Float, key: Key,
        numbers: mi.UInt32, straight: Straight,
    ) -> list[Irradiance]:  # fmt: skip
        """D [sr] of receivers by every window, and last by none of them.

        Parameters
        ----------
        deposit : Deposit
            Deposit after `lit`.
        on_diffusers : list of Irradiance
            From the method of this name.
        p, n, key, numbers
            As for `Deposit.straight`.
        straight : callable
            Computes straight light of a deposit on the receivers.
        """
        parts = self._parted(deposit, straight)
        if on_diffusers:
            transfer = deposit.transfer(p, n, key, numbers)
            evenly = (Irradiance(*(transfer @ E for E in lit)) for lit in on_diffusers)
            parts = [part.plus(more) for part, more in zip(parts, evenly, strict=True)]
        return [
            part.plus(self._by_films(deposit, p, n, key, numbers, k))
            for k, part in enumerate(parts)
        ]

    def _parted(self, deposit: Deposit, straight: Straight) -> list[Irradiance]:
        """Straight light by window, see `parts`."""
        before, out = straight(deposit), []
        for scene in self.blocked:
            after = straight(replace(deposit, scene=scene))
            out.append(Irradiance(*(a - b for a, b in zip(before, after, strict=True))))
            before = after
        return [*out, before]

    def _by_films(
        self, deposit: Deposit, p: mi.Float, n: mi.Float, key: Key, numbers: mi.UInt32 | None,
        window: int,
    ) -> Irradiance | None:  # fmt: skip
        """D by way of the films of a window; None without any."""
        among = None if self.of_film is None else self.of_film == window
        if among is None or not among.any() or deposit.on_films is None:
            return None
        return deposit.by_looked(deposit.looked(p, n, key, numbers), p, n, key, numbers, among)


def _column(mask: np.ndarray) -> mi.TensorXf:
    """Factor 1 or 0 of rows, shape (row, 1)."""
    return mi.TensorXf(mi.Float(mask.astype(np.float32)), (len(mask), 1))


def _with(scene: mi.Scene | None, more: dict[str, mi.Shape]) -> mi.Scene | None:
    """Scene with further shapes; None without a scene."""
    if scene is None:
        return None
    shapes = {f"shape{i}": shape for i, shape in enumerate(scene.shapes())}
    return mitsuba_scene({**shapes, **more})


def _windows_of(patches: PanePatches, windows: Windows) -> np.ndarray:
    """Window of every patch, int, shape (patch,); the number of windows for none.

    A ray through the middle of a patch meets the pane that it is part of.
    """
    if not len(windows):
        return np.zeros(len(patches), int)
    share = np.where(patches.triangular, 1 / 3, 1 / 2)[:, None]
    start = patches.corner + share * (patches.u + patches.v) + ON_PANE * patches.normal
    each = dr.arange(mi.UInt32, len(patches))
    p, d = (dr.gather(mi.Vector3f, flat(a), each) for a in (start, -patches.normal))
    met, quad = windows.met(mi.Ray3f(mi.Point3f(p), d, 2 * ON_PANE, 0, []), mi.Bool(True))
    window = dr.gather(mi.UInt32, windows.of_quad, quad, met)
    return np.where(met.numpy(), window.numpy(), len(windows))
