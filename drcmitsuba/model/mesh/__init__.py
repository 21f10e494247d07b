"""Mesh files: OBJ, PLY, STL, glTF and GLB.

reader
    `read`: from a file and a table of materials to a model.
obj, ply, stl, gltf
    Parts of a file of each kind.
part, text
    Part of a file and the bounds of its values; lines of text files.
"""

from drcmitsuba.model.mesh.reader import read

__all__ = ["read"]
