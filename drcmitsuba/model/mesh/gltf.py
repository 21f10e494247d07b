"""glTF 2.0 files: .glb, and .gltf with its buffers beside it or within."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from drcmitsuba.model.facets import facet_quads, join
from drcmitsuba.model.materials import Reflectance
from drcmitsuba.model.mesh.part import (
    LARGEST,
    MeshPart,
    beside,
    check_count,
    check_index,
    check_vertices,
    doubles,
)
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.source_file import read_bytes
from drcmitsuba.runtime.errors import InputError

LARGEST_JSON = 32 * 2**20
"""Largest description of a scene [B]."""
TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""Types of numbers by their code."""
SIZES = {"SCALAR": 1, "VEC3": 3}
KNOWN = ("KHR_materials_", "KHR_texture_", "KHR_lights_punctual", "KHR_mesh_quantization")
"""Beginnings of the names of extensions without which geometry can be read."""


class _MalformedError(Exception):
    """A fault of a file, in words."""


def read_gltf(file: Path, notes: Notes) -> list[MeshPart]:
    """Parts of a glTF file in metres, z up: its default scene, by material, mesh and node.

    Points, lines, cameras, lights, skins and animations are left out.
    """
    content = read_bytes(file, LARGEST)
    try:
        scene, inner = _chunks(content)
        with np.errstate(all="ignore"):  # coordinates beyond all bounds are refused by their value
            return _Scene(file, scene, inner, notes).parts()
    except _MalformedError as error:
        raise InputError(file, "glTF", str(error), "export the mesh again") from None
    except RecursionError:
        got = "objects within objects without end"
        raise InputError(file, "glTF", got, "export the mesh again") from None
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        got = f"not as its schema has it ({type(error).__name__}: {error})"
        raise InputError(file, "glTF", got, "export the mesh again") from None


def _chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    """Description and binary chunk of a file."""
    description, inner = content, b""
    if content[:4] == b"glTF":
        version, _ = struct.unpack_from("<II", content.ljust(12, b"\0"), 4)
        if version != 2:
            raise _MalformedError(f"version {version}, not 2")
        at = 12
        while at + 8 <= len(content):
            length, kind = struct.unpack_from("<I4s", content, at)
            part = content[at + 8 : at + 8 + length]
            if kind == b"JSON":
                description = part
            elif kind == b"BIN\0":
                inner = part
            at += 8 + length
    if len(description) > LARGEST_JSON:
        raise _MalformedError(f"a description larger than {LARGEST_JSON // 2**20} MiB")
    scene = json.loads(description)
    if not isinstance(scene, dict) or not str(scene["asset"]["version"]).startswith("2."):
        raise _MalformedError("no scene of version 2")
    return scene, inner


class _Scene:
    """Description of a scene with its buffers."""

    def __init__(self, file: Path, scene: dict[str, Any], inner: bytes, notes: Notes) -> None:
        self.file, self.scene, self.inner, self.notes = file, scene, inner, notes
        self.buffers: dict[int, bytes] = {}
        self.vertices = 0
        for name in scene.get("extensionsRequired", []):
            if not str(name).startswith(KNOWN):
                remedy = "export it without this extension"
                raise InputError(file, "extensionsRequired", str(name), remedy)
        if scene.get("images"):
            notes.add("Textures are left out")

    def parts(self) -> list[MeshPart]:
        """Surfaces of every node of the scene."""
        quads: dict[tuple[int | None, str, str], list[np.ndarray]] = {}
        count = 0
        for node, matrix in self._nodes():
            if node.get("mesh") is None:
                continue
            mesh = self._item("meshes", node["mesh"])
            for primitive in mesh["primitives"]:
                corners = self._triangles(primitive)
                count += len(corners)
                check_count(self.file, "polygons", count)
                corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
                if np.linalg.det(matrix[:3, :3]) < 0:
                    corners = corners[:, ::-1]
                corners = corners[:, :, [0, 2, 1]] * [1.0, -1.0, 1.0]  # from y up to z up
                check_vertices(self.file, corners)
                key = (
                    primitive.get("material"),
                    str(mesh.get("name", "")),
                    str(node.get("name", "")),
                )
                quads.setdefault(key, []).append(facet_quads(corners)[0])
        return [
            MeshPart(*self._names(*key), join(np.concatenate(each))[0], self._reflectance(key[0]))
            for key, each in quads.items()
        ]

    def _names(self, material: int | None, mesh: str, node: str) -> tuple[tuple[str, ...]]:
        """Names of material, mesh and node that there are."""
        own = ""
        if material is not None:
            own = str(self._item("materials", material).get("name", "")) or f"material {material}"
        return (tuple(dict.fromkeys(name for name in (own, mesh, node) if name)),)

    def _reflectance(self, material: int | None) -> Reflectance | None:
        """Base colour of an opaque material without a texture [–]."""
        if material is None:
            return None
        of = self._item("materials", material)
        base = of.get("pbrMetallicRoughness", {})
        factor = base.get("baseColorFactor")
        clear = of.get("alphaMode", "OPAQUE") != "OPAQUE"
        clear |= "KHR_materials_transmission" in of.get("extensions", {})
        if factor is None or "baseColorTexture" in base or clear:
            return None
        r, g, b = (float(value) for value in factor[:3])
        if not all(0 <= value <= 1 for value in (r, g, b)):
            return None
        return r if r == g == b else (r, g, b)

    def _item(self, key: str, index: object) -> dict[str, Any]:
        """Object of one of the scene's lists."""
        items = self.scene.get(key, [])
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(items):
            raise _MalformedError(f"{key}: none of index {index!r}")
        item = items[index]
        if not isinstance(item, dict):
            raise _MalformedError(f"{key}[{index}]: no object")
        return item

    def _nodes(self) -> list[tuple[dict[str, Any], np.ndarray]]:
        """Nodes of the default scene with their transforms (4, 4)."""
        if self.scene.get("scenes"):
            roots = self._item("scenes", self.scene.get("scene", 0)).get("nodes", [])
        else:
            nodes = self.scene.get("nodes", [])
            below = {child for node in nodes for child in node.get("children", [])}
            roots = [k for k in range(len(nodes)) if k not in below]
        out = []
        seen: set[int] = set()
        stack = [(root, np.eye(4)) for root in roots]
        while stack:
            index, above = stack.pop()
            node = self._item("nodes", index)
            if index in seen:
                raise _MalformedError(f"nodes[{index}]: part of the scene twice")
            seen.add(index)
            matrix = above @ _transform(node)
            out.append((node, matrix))
            stack += [(child, matrix) for child in reversed(node.get("children", []))]
        return out

    def _triangles(self, primitive: dict[str, Any]) -> np.ndarray:
        """Corners of the triangles of a primitive, shape (triangle, 3, 3)."""
        mode = primitive.get("mode", 4)
        if mode not in (4, 5, 6):
            self.notes.add("Points and lines are left out")
            return np.empty((0, 3, 3))
        vertices = doubles(self._numbers(primitive["attributes"]["POSITION"], "VEC3"))
        self.vertices += len(vertices)
        check_count(self.file, "vertices", self.vertices)
        index = np.arange(len(vertices))
        if primitive.get("indices") is not None:
            index = self._numbers(primitive["indices"], "SCALAR")[:, 0].astype(np.int64)
        check_index(self.file, index, len(vertices))
        if mode == 4:
            return vertices[index[: len(index) // 3 * 3]].reshape(-1, 3, 3)
        second = np.arange(1, max(1, len(index) - 1))
        first = np.where(second % 2 == 1, second - 1, second) if mode == 5 else 0 * second
        middle = np.where(second % 2 == 1, second, second - 1) if mode == 5 else second
        return vertices[index[np.stack([first, middle, second + 1], axis=1)]]

    def _numbers(self, accessor: object, kind: str) -> np.ndarray:
        """Numbers of an accessor, shape (count, size)."""
        of = self._item("accessors", accessor)
        if "sparse" in of or of.get("bufferView") is None:
            raise _MalformedError("a sparse accessor")
        if of.get("type") != kind or of.get("componentType") not in TYPES:
            raise _MalformedError(f"accessors[{accessor}]: no {kind} of a known type")
        view = self._item("bufferViews", of["bufferView"])
        item = np.dtype(TYPES[of["componentType"]])
        size, count = SIZES[kind], of["count"]
        if not isinstance(count, int) or count < 0:
            raise _MalformedError(f"accessors[{accessor}]: count {count!r}")
        check_count(self.file, "vertices", count)
        step = view.get("byteStride") or size * item.itemsize
        start, length = view.get("byteOffset", 0), view["byteLength"]
        offset = of.get("byteOffset", 0)
        content = self._buffer(view["buffer"])
        numbers = (step, start, length, offset)
        if not all(isinstance(each, int) and each >= 0 for each in numbers):
            raise _MalformedError(f"accessors[{accessor}]: a negative place")
        end = offset + (count - 1) * step + size * item.itemsize if count else 0
        if end > length or start + length > len(content):
            raise _MalformedError(f"accessors[{accessor}]: beyond the end of its buffer")
        shape, strides = (count, size), (step, item.itemsize)
        values = np.ndarray(shape, item, content, start + offset, strides)
        if of.get("normalized") and item.kind in "iu":
            return np.maximum(values / float(np.iinfo(item).max), -1.0)
        return values

    def _buffer(self, index: object) -> bytes:
        """Content of a buffer: the file's own, within its description, or a file beside it."""
        of = self._item("buffers", index)
        assert isinstance(index, int)
        if index not in self.buffers:
            uri = of.get("uri")
            if uri is None and index == 0 and self.inner:
                self.buffers[index] = self.inner
            elif isinstance(uri, str) and uri.startswith("data:"):
                try:
                    self.buffers[index] = base64.b64decode(uri.partition(",")[2])
                except binascii.Error:
                    raise _MalformedError(f"buffers[{index}]: no base64") from None
            else:
                path = beside(self.file, unquote(uri)) if isinstance(uri, str) else None
                if path is None:
                    remedy = "put its buffers beside it, or export it as .glb"
                    raise InputError(self.file, f"buffers[{index}].uri", repr(uri), remedy)
                left = LARGEST - sum(len(each) for each in self.buffers.values())
                self.buffers[index] = read_bytes(path, max(left, 0))
        return self.buffers[index]


def _transform(node: dict[str, Any]) -> np.ndarray:
    """Transform (4, 4) of a node: its matrix, or scale, rotation and translation."""
    if node.get("matrix") is not None:
        matrix = np.array(node["matrix"], float).reshape(4, 4).T
    else:
        x, y, z, w = np.array(node.get("rotation", [0, 0, 0, 1]), float)
        matrix = np.eye(4)
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        matrix[:3, :3] *= np.array(node.get("scale", [1, 1, 1]), float).reshape(1, 3)
        matrix[:3, 3] = np.array(node.get("translation", [0, 0, 0]), float).reshape(3)
    if not np.abs(matrix).max() <= 1e9:
        raise _MalformedError("a transform that is no number, or far away")
    return matrix
