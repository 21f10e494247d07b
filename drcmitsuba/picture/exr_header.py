"""Header of an OpenEXR file, read before its pixels: strangers' files may state any size.

The layout of the header is that of the file format's description [1]_: a magic number, a version
with flags, then attributes (name, type, size, value) up to an empty name.

References
----------
.. [1] "OpenEXR file layout", Academy Software Foundation.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drcmitsuba.picture.picture import RADIANCE, Primaries, refuse_size, to_xyz
from drcmitsuba.picture.view import PictureView, from_options
from drcmitsuba.runtime.errors import InputError

MAGIC = b"\x76\x2f\x31\x01"
LONGEST = 1 << 20
"""Largest size of a header [byte]."""
_LONGEST_NAME = 255
_TILED, _DEEP, _PARTS = 0x200, 0x800, 0x1000
_UINT, _HALF, _FLOAT = range(3)
_BYTES = {_UINT: 4, _HALF: 2, _FLOAT: 4}
BT709: Primaries = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
"""Chromaticities of files that state none, as the format has it."""


@dataclass(frozen=True)
class ExrHeader:
    """Header of a picture."""

    channels: Mapping[str, int]
    """Type of each channel: 0, 1 and 2 for integers, half and float."""
    white: float | None
    """Luminance of red, green and blue of 1 [cd/m²]; None where the file does not say it."""
    exposure: float
    """Radiance's exposure [–]; 1 where the file does not say it."""
    primaries: Primaries
    view: PictureView | None
    captured: str


def read(raw: bytes, file: Path) -> ExrHeader:
    """Read the header of a file with one picture.

    Parameters
    ----------
    raw : bytes
        The file, or as much of it as holds the header.
    file : Path
        Its path, for messages.

    Raises
    ------
    InputError
        The header breaks off, states deep pixels, several parts or more than fits in memory, or an
        attribute is unfit.
    """
    try:
        attributes = _attributes(raw)
    except (IndexError, ValueError, struct.error):
        raise InputError(file, "header", "it breaks off", "give a whole .exr file") from None
    (version,) = struct.unpack_from("<I", raw, 4)
    if version & 0xFF != 2 or version & (_DEEP | _PARTS):
        got = f"version {version:#x}: deep pixels, several parts, or another format"
        raise InputError(file, "header", got, "give a file with one flat picture")
    try:
        left, bottom, right, top = struct.unpack("<4i", attributes["dataWindow"])
        channels = _channels(attributes["channels"])
        if version & _TILED:
            across, up, _ = struct.unpack("<IIB", attributes["tiles"])
            refuse_size(file, across, up, 4 * max(1, len(channels)))
        refuse_size(
            file, right - left + 1, top - bottom + 1, sum(_BYTES[c] for c in channels.values())
        )
        return ExrHeader(
            channels, _white(attributes), _exposure(attributes), _primaries(attributes),
            _view(attributes, file), _string(attributes, "capDate")[:32],
        )  # fmt: skip
    except InputError as error:
        raise InputError(file, error.field, error.got, error.remedy) from None
    except (KeyError, IndexError, ValueError, struct.error) as error:
        got = f"an attribute is missing or unfit ({error})"
        raise InputError(file, "header", got, "give a whole .exr file") from None


def _attributes(raw: bytes) -> dict[str, bytes]:
    """Values of all attributes by their name."""
    values: dict[str, bytes] = {}
    at = 8
    while True:
        end = raw.index(b"\0", at, at + _LONGEST_NAME + 1)
        if end == at:
            return values
        kind = raw.index(b"\0", end + 1, end + _LONGEST_NAME + 2)
        (size,) = struct.unpack_from("<i", raw, kind + 1)
        begin = kind + 5
        if not 0 <= size <= LONGEST - begin or begin + size > len(raw):
            raise ValueError("an attribute larger than the header")
        values[raw[at:end].decode("latin-1")] = raw[begin : begin + size]
        at = begin + size


def _channels(value: bytes) -> dict[str, int]:
    """Types of the channels by their name; each has a value for every pixel, else InputError."""
    channels, at = {}, 0
    while value[at]:
        end = value.index(b"\0", at, at + _LONGEST_NAME + 1)
        kind, _, across, down = struct.unpack_from("<iI2i", value, end + 1)
        name = value[at:end].decode("latin-1")
        if kind not in _BYTES or (across, down) != (1, 1):
            got = f"type {kind}, one value for {across} by {down} pixels"
            raise InputError("", f"channel {name!r}", got, "give half or float for every pixel")
        channels[name] = kind
        at = end + 17
    return channels


def _string(attributes: Mapping[str, bytes], name: str) -> str:
    return attributes.get(name, b"").decode("utf-8", "replace")


def _positive(value: float, name: str) -> float:
    if not 1e-30 < value < 1e30:
        raise InputError("", name, f"{value:g}", "give a number above 0")
    return value


def _white(attributes: Mapping[str, bytes]) -> float | None:
    if "whiteLuminance" not in attributes:
        return None
    (white,) = struct.unpack("<f", attributes["whiteLuminance"])
    return _positive(white, "whiteLuminance")


def _exposure(attributes: Mapping[str, bytes]) -> float:
    """Radiance's exposure, which other programs write as float or text."""
    value = attributes.get("EXPOSURE", b"1")
    number = struct.unpack("<f", value)[0] if len(value) == 4 else float(value)
    return _positive(number, "EXPOSURE")


def _primaries(attributes: Mapping[str, bytes]) -> Primaries:
    if "chromaticities" not in attributes:
        return BT709
    stated: Primaries = struct.unpack("<8f", attributes["chromaticities"])
    if max(abs(a - b) for a, b in zip(stated, RADIANCE, strict=True)) < 1e-4:
        return RADIANCE
    to_xyz(stated)
    return stated


def _view(attributes: Mapping[str, bytes], file: Path) -> PictureView | None:
    options = _string(attributes, "VIEW")
    return from_options(options, file) if options else None
