"""Illuminance by sky and by sun on the device: sums over bins, and statistics over replicates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat, flat_indices, repeated, row_and_column, shared

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

TOGETHER = 1 << 24
"""Largest number of coefficients, or of illuminances, of all replicates in a launch, 64 MiB."""
SUMMED = 1 << 9
"""Number of patches whose light is summed in single precision: more of them would drift."""
FOUR = 4
"""Number of replicates whose sums are made together."""
INDEXED = 1 << 30
"""Largest number of coefficients that are on the device at once, 4 GiB."""
SOURCES = ("sky", "sun", "total")


def source_sums(
    C: np.ndarray, patches: np.ndarray, L: np.ndarray, suns: csr_matrix
) -> dict[str, np.ndarray]:
    """Mean and standard error of E = C·L by the sky, by the sun, and in total.

    Parameters
    ----------
    C : np.ndarray, shape (replicate, sensor, bin)
        Coefficients [sr].
    patches : np.ndarray of int, shape (patch,)
        Bins of the ground and the sky patches.
    L : np.ndarray, shape (time, patch)
        Their luminances [cd/m²].
    suns : csr_matrix, shape (time, bin)
        Luminances of the bins that stand for the sun of each time stamp [cd/m²].

    Returns
    -------
    dict of np.ndarray, shape (time, sensor)
        `sky`, `sun`, `total` and `…_se` [lx].
    """
    backend.select()
    names, shape = [n + s for n in SOURCES for s in ("", "_se")], (len(L), C.shape[1])
    used, place = np.unique(suns.indices, return_inverse=True)
    if not suns.nnz:  # no loop takes empty arrays
        used = patches[:1]
    pieces = np.split(patches, range(SUMMED, len(patches), SUMMED))
    first, bins, light = _rows(suns, place)
    step = max(1, TOGETHER // (len(C) * max(1, len(patches) + len(used), len(L))))
    out = {name: np.empty(shape, np.float32) for name in names}
    for start in range(0, shape[1] if len(L) else 0, step):
        here = slice(start, start + step)
        *of_sky, of_sun = _by_bin(C[:, here], [*pieces, used])
        by_sky = _by_sky(L, of_sky)
        values = _statistics(by_sky, first, bins, light, of_sun.array, len(L), of_sun.shape)
        dr.eval(values)
        for name, part in zip(names, values, strict=True):
            E = part.numpy().reshape(len(L), -1)
            if E.shape == shape:
                out[name] = E  # a copy would take memory
            else:
                out[name][:, here] = E
    return out


def sums_at(
    C: np.ndarray, patches: np.ndarray, L: np.ndarray, suns: csr_matrix, time: np.ndarray,
    sensor: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """E = C·L of every replicate at some entries, shape (replicate, entry) [lx].

    `time` and `sensor` (entry,) are indices; the rest as for `source_sums`. Entries that are sorted
    by sensor, then by time, take the least time.
    """
    backend.select()
    out = np.empty((len(C), len(time)), np.float32)
    if out.size == 0:
        return out
    at, by_time = (flat_indices(time), flat_indices(sensor)), flat(L.T)
    bins, rows = flat_indices(patches), _rows(suns, suns.indices)
    step = max(1, INDEXED // (FOUR * C[0].size)) * FOUR
    for first in range(0, len(C), step):
        part = C[first : first + step]
        values, last = shared(part), len(part) - 1
        for start in range(0, len(part), FOUR):
            four = mi.Vector4u(*(dr.opaque(mi.UInt32, min(start + i, last)) for i in range(FOUR)))
            E = _sums_at(values, four, bins, by_time, rows, at, (*C.shape[1:], *L.T.shape))
            out[first + start : first + start + FOUR] = E.numpy()[: len(part) - start]
    return out


def _rows(suns: csr_matrix, place: np.ndarray) -> tuple[mi.UInt32, mi.UInt32, mi.Float]:
    """First entry of each time stamp, then the place of the sun and the luminance of an entry."""
    if not suns.nnz:  # no loop takes empty arrays
        return flat_indices(suns.indptr), flat_indices([0]), flat([0])
    return flat_indices(suns.indptr), flat_indices(place), flat(suns.data)


@symbolic
def _sums_at(
    C: mi.Float, four: mi.Vector4u, patches: mi.UInt32, L: mi.Float,
    suns: tuple[mi.UInt32, mi.UInt32, mi.Float], at: tuple[mi.UInt32, mi.UInt32],
    count: tuple[int, int, int, int],
) -> mi.Vector4f:  # fmt: skip
    """E by four replicates; C is flat (replicate, sensor, bin), L flat (patch, time).

    `four` are the replicates; `count` are sensors, bins, patches, times.
    """
    (first, bins, luminances), (time, sensor) = suns, at
    begin = four * dr.opaque(mi.UInt32, count[0] * count[1])
    lane = dr.arange(mi.UInt32, count[0] * count[2])
    row, patch = row_and_column(lane, count[2])
    place = row * dr.opaque(mi.UInt32, count[1]) + dr.gather(mi.UInt32, patches, patch)
    by_patch = dr.ravel(mi.Vector4f(*(dr.gather(mi.Float, C, place + b) for b in begin)))
    dr.eval(by_patch)
    number, times = (dr.opaque(mi.UInt32, n) for n in count[2:])
    row, place, total, i = sensor * number, mi.UInt32(time), mi.Vector4d(0), mi.UInt32(0)
    while i < number:  # the four lie side by side: to read them takes little more than one
        total += dr.gather(mi.Vector4f, by_patch, row + i) * dr.gather(mi.Float, L, place)
        place += times
        i += 1
    row = sensor * dr.opaque(mi.UInt32, count[1])
    entry, end = dr.gather(mi.UInt32, first, time), dr.gather(mi.UInt32, first, time + 1)
    while entry < end:
        bin = row + dr.gather(mi.UInt32, bins, entry)
        of_sun = mi.Vector4f(*(dr.gather(mi.Float, C, bin + b) for b in begin))
        total += of_sun * dr.gather(mi.Float, luminances, entry)
        entry += 1
    return mi.Vector4f(total)


def _by_bin(C: np.ndarray, parts: list[np.ndarray]) -> list[mi.TensorXf]:
    """Coefficients (replicate, bin, sensor) of some parts of the bins."""
    by_bin = C.transpose(0, 2, 1)
    if by_bin.flags.c_contiguous:  # rows are copied as they are
        return [mi.TensorXf(flat(rows), rows.shape) for rows in (by_bin[:, b] for b in parts)]
    (replicates, sensors, every), values = C.shape, shared(C)

    def of(bins: np.ndarray) -> mi.TensorXf:
        shape = (replicates, len(bins), sensors)
        row, sensor = row_and_column(dr.arange(mi.UInt32, int(np.prod(shape))), sensors)
        replicate, number = row_and_column(row, len(bins))
        at = replicate * dr.opaque(mi.UInt32, sensors) + sensor
        at = at * dr.opaque(mi.UInt32, every) + dr.gather(mi.UInt32, flat_indices(bins), number)
        part = dr.gather(mi.Float, values, at)
        dr.eval(part)
        return mi.TensorXf(part, shape)

    return [of(bins) for bins in parts]


def _by_sky(L: np.ndarray, of_sky: list[mi.TensorXf]) -> mi.Float:
    """E by the sky, flat (replicate, time, sensor), from C of pieces of the patches."""
    parts, start = [], 0
    for C in of_sky:
        replicates, patches, _ = C.shape
        piece = flat(L[:, start : start + patches])
        each = mi.TensorXf(repeated(piece, replicates), (replicates, len(L), patches))
        parts.append((each @ C).array)
        start += patches
    return parts[0] if len(parts) == 1 else mi.Float(sum(map(mi.Float64, parts)))


@symbolic
def _statistics(
    by_sky: mi.Float, first: mi.UInt32, bins: mi.UInt32, luminances: mi.Float, of_sun: mi.Float,
    times: int, count: tuple[int, int, int],
) -> list[mi.Float]:  # fmt: skip
    """Means and standard errors, flat (time, sensor), of `count` replicates, suns and sensors.

    Differences from the first replicate keep the digits, as in `schema.mean_and_error`.
    """
    replicates, suns, sensors = (dr.opaque(mi.UInt32, n) for n in count)
    lane = dr.arange(mi.UInt32, times * count[2])
    time, sensor = row_and_column(lane, count[2])
    begin, end = dr.gather(mi.UInt32, first, time), dr.gather(mi.UInt32, first, time + 1)
    size, r = dr.opaque(mi.UInt32, times * count[2]), mi.UInt32(0)
    start, total, squares = mi.Vector3f(0), mi.Vector3f(0), mi.Vector3f(0)
    # Most suns are one bin: it is looked up once for all replicates.
    shines, stride = begin < end, suns * sensors
    place = dr.gather(mi.UInt32, bins, begin, shines) * sensors + sensor
    luminance = dr.gather(mi.Float, luminances, begin, shines)
    while r < replicates:
        sun = luminance * dr.gather(mi.Float, of_sun, r * stride + place, shines)
        entry = begin + 1
        while entry < end:
            row = r * suns + dr.gather(mi.UInt32, bins, entry)
            value = dr.gather(mi.Float, of_sun, row * sensors + sensor)
            sun += dr.gather(mi.Float, luminances, entry) * value
            entry += 1
        sky = dr.gather(mi.Float, by_sky, r * size + lane)
        E = mi.Vector3f(sky, sun, sky + sun)
        start = dr.select(r == 0, E, start)
        total += E - start
        squares += dr.square(E - start)
        r += 1
    n = mi.Float(replicates)
    mean, spread = total / n, dr.maximum(squares - dr.square(total) / n, 0)
    error = dr.sqrt(spread / (n * (n - 1)))
    return [part[i] for i in range(3) for part in (start + mean, error)]
