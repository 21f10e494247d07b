"""Scanlines of Radiance pictures: three mantissas and their common exponent, a byte each.

A pixel (r, g, b, e) means (r + 0.5) · 2^(e − 136) and so on; e = 0 is black [1]_. Scanlines come
flat, as pixels and repeats of pixels, or as runs of each of the four bytes.

References
----------
.. [1] G. Ward, "Real pixels", Graphics Gems II, 1991.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drcmitsuba.runtime.errors import InputError

BLOCK = 64
"""Number of scanlines that are converted at a time."""
RUNS = range(8, 32768)
"""Numbers of pixels of scanlines that may be written as runs of bytes."""
_LONGEST_RUN = 127
_SHORTEST_RUN = 4


def decode(raw: bytes, at: int, scanlines: int, width: int, file: Path) -> np.ndarray:
    """Values of the pixels, float32, shape (scanline, pixel, 3).

    Parameters
    ----------
    raw : bytes
        The whole file.
    at : int
        Place of the first pixel [byte].
    scanlines, width : int
        Number of scanlines, and of the pixels of each.
    file : Path
        Its path, for messages.

    Raises
    ------
    InputError
        The pixels break off or do not fit the scanlines.
    """
    values = np.empty((scanlines, width, 3), np.float32)
    quads = np.empty((BLOCK, width, 4), np.uint8)
    for top in range(0, scanlines, BLOCK):
        count = min(BLOCK, scanlines - top)
        for i in range(count):
            try:
                quads[i], at = _scanline(raw, at, width)
            except (IndexError, ValueError):
                got = f"scanline {top + i + 1} of {scanlines} breaks off or has no fit lengths"
                raise InputError(file, "pixels", got, "give a whole picture") from None
        values[top : top + count] = _values(quads[:count])
    return values


def _scanline(raw: bytes, at: int, width: int) -> tuple[np.ndarray, int]:
    """Pixels (width, 4) of a scanline, and the place of the next one."""
    is_runs = width in RUNS and raw[at] == raw[at + 1] == 2 and raw[at + 2] < 128
    if not is_runs:
        return _repeated(raw, at, width)
    if raw[at + 2] << 8 | raw[at + 3] != width:
        raise ValueError("another width")
    return _runs(raw, at + 4, width)


def _runs(raw: bytes, at: int, width: int) -> tuple[np.ndarray, int]:
    """Pixels of which each byte comes in runs: a length above 128 repeats one byte."""
    line = bytearray()
    for end in range(width, 4 * width + 1, width):
        while len(line) < end:
            length = raw[at]
            if length > 128:
                line += raw[at + 1 : at + 2] * (length - 128)
                at += 2
            elif length:
                line += raw[at + 1 : at + 1 + length]
                at += 1 + length
            else:
                raise ValueError("a run of no length")
        if len(line) > end or at > len(raw):
            raise ValueError("runs longer than the scanline")
    return np.frombuffer(line, np.uint8).reshape(4, width).T, at


def _repeated(raw: bytes, at: int, width: int) -> tuple[np.ndarray, int]:
    """Pixels as they are; (1, 1, 1, n) repeats the pixel before n times.

    Repeats that follow each other are the digits of one number to the base 256, the lowest first.
    """
    quads = np.frombuffer(raw, np.uint8, 4 * min(width, (len(raw) - at) // 4), at).reshape(-1, 4)
    is_repeat = (quads[:, :3] == 1).all(axis=1)
    if not is_repeat.any():
        if len(quads) < width:
            raise ValueError("breaks off")
        return quads, at + 4 * width
    if is_repeat[0]:
        raise ValueError("a repeat of nothing")
    own = np.maximum.accumulate(np.where(is_repeat, 0, np.arange(len(quads))))
    digit = np.arange(len(quads)) - own - 1
    if digit.max() > 3:
        raise ValueError("a repeat longer than any scanline")
    count = np.where(is_repeat, quads[:, 3].astype(np.int64) << 8 * np.maximum(digit, 0), 1)
    filled = np.cumsum(count)
    last = int(np.searchsorted(filled, width))
    if last == len(quads) or filled[last] != width:
        raise ValueError("repeats do not fit the scanline")
    return np.repeat(quads[own[: last + 1]], count[: last + 1], axis=0), at + 4 * (last + 1)


def _values(quads: np.ndarray) -> np.ndarray:
    """Values (…, 3) of pixels (…, 4)."""
    exponent = quads[..., 3:].astype(np.int32)
    scale = np.where(exponent > 0, np.ldexp(np.float32(1), exponent - 136), np.float32(0))
    return (quads[..., :3] + np.float32(0.5)) * scale


def encode(values: np.ndarray) -> bytes:
    """Scanlines of values (scanline, pixel, 3), as runs of bytes where their width allows.

    Negative values become 0, and so do those below 1e-32.
    """
    parts = []
    for line in values:
        quads = _quads(line)
        if len(line) not in RUNS:
            parts.append(quads.tobytes())
            continue
        parts.append(bytes([2, 2, len(line) >> 8, len(line) & 255]))
        parts += [_encoded(quads[:, channel]) for channel in range(4)]
    return b"".join(parts)


def _quads(values: np.ndarray) -> np.ndarray:
    """Pixels (…, 4) of values (…, 3)."""
    values = np.maximum(values, 0).astype(np.float64)
    largest = values.max(axis=-1)
    _, exponent = np.frexp(largest)
    shown = largest > 1e-32
    quads = np.zeros((*values.shape[:-1], 4), np.uint8)
    mantissa = np.floor(np.ldexp(values, 8 - exponent[..., None]))
    quads[..., :3] = np.where(shown[..., None], mantissa, 0)
    quads[..., 3] = np.where(shown, exponent + 128, 0)
    return quads


def _encoded(line: np.ndarray) -> bytes:
    """Bytes of one channel of a scanline as runs."""
    starts = np.flatnonzero(np.diff(line, prepend=line[0] ^ 1))
    lengths = np.diff(starts, append=len(line))
    raw, parts, at = line.tobytes(), [], 0
    long = lengths >= _SHORTEST_RUN
    for start, length in zip(starts[long].tolist(), lengths[long].tolist(), strict=True):
        parts.append(_literal(raw[at:start]))
        parts += [
            bytes([128 + min(_LONGEST_RUN, length - done), raw[start]])
            for done in range(0, length, _LONGEST_RUN)
        ]
        at = start + length
    return b"".join([*parts, _literal(raw[at:])])


def _literal(raw: bytes) -> bytes:
    """Bytes as they are, in pieces of at most 128."""
    pieces = (raw[at : at + 128] for at in range(0, len(raw), 128))
    return b"".join(bytes([len(piece)]) + piece for piece in pieces)
