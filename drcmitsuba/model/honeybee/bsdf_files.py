"""BSDF files that an HBJSON file holds."""

from __future__ import annotations

import base64
import binascii
import lzma
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from drcmitsuba.model.honeybee.entries import JsonEntry, by_identifier, read_entry
from drcmitsuba.model.written_files import written

LARGEST_BSDF = 256 * 2**20
"""Largest size of the BSDF files that are unpacked from a model, together [B]."""


@dataclass
class BsdfFiles:
    """BSDF files by the identifiers of their modifiers."""

    given: Mapping[str, Path]
    """Files that the caller has written."""
    unpacked: dict[str, Path] = field(default_factory=dict)
    """Files that were written here."""

    def file(self, modifier: JsonEntry) -> Path:
        """File of a modifier; its data is unpacked where the caller gave none.

        Raises
        ------
        InputError
            The data is no XML, or the files of the model are larger than 256 MiB together.
        """
        name = modifier.identifier()
        if name not in self.given and name not in self.unpacked:
            left = LARGEST_BSDF - sum(path.stat().st_size for path in self.unpacked.values())
            self.unpacked[name] = written(_unpacked(modifier, left), name)
        return self.given.get(name) or self.unpacked[name]


def bsdf_xml(file: Path) -> dict[str, bytes]:
    """Content of the BSDF files that an HBJSON file holds, by the modifier's identifier.

    `read` unpacks them for the length of the process; write these where they shall stay, and give
    it their paths, for workers on other machines.

    Raises
    ------
    InputError
        The file is no HBJSON file, or its data is no XML, plain or packed by gzip, zlib or LZMA
        as base64, of at most 256 MiB together.
    """
    radiance = read_entry(file).inner("properties", "radiance")
    modifiers = radiance.entries("modifiers")
    modifiers += radiance.inner("global_modifier_set").entries("modifiers")
    found = [each for each in modifiers if each.text("type") == "BSDF"]
    files, left = {}, LARGEST_BSDF
    for name, modifier in by_identifier(found, alike=True).items():
        files[name] = _unpacked(modifier, left)
        left -= len(files[name])
    return files


def _unpacked(modifier: JsonEntry, most: int) -> bytes:
    """XML of a BSDF modifier, of at most so many bytes."""
    packed = (modifier.text("bsdf_data") or "").encode()
    try:
        content = packed if b"<" in packed[:100] else _inflated(base64.b64decode(packed), most)
    except (binascii.Error, zlib.error, lzma.LZMAError, EOFError):
        content = b""
    if b"<" not in content[:100] or len(content) > most:
        got = "larger than 256 MiB" if len(content) > most else "no XML, plain or packed"
        raise modifier.refuse("bsdf_data", got, "export the model again")
    return content


def _inflated(packed: bytes, most: int) -> bytes:
    """Bytes that gzip, zlib or LZMA packed, up to one above the most."""
    if packed[:3] == b"\xfd7z" or packed[:3] == b"\x5d\x00\x00":
        return lzma.LZMADecompressor(memlimit=LARGEST_BSDF).decompress(packed, most + 1)
    if packed[:2] == b"\x1f\x8b" or packed[:1] == b"\x78":
        return zlib.decompressobj(wbits=47).decompress(packed, most + 1)
    return packed
