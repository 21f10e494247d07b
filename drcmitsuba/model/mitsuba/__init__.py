"""Mitsuba scenes as models: XML files, and dictionaries as `mi.load_dict` takes them.

entries
    Entries of a scene: shapes, BSDFs, references and numbers.
xml
    XML files as entries.
dictionary
    Dictionaries as entries.
shapes
    Shapes as quads.
bsdfs
    BSDFs as materials.
reader
    `read` and `from_dict`.
"""

from drcmitsuba.model.mitsuba.reader import from_dict, read

__all__ = ["from_dict", "read"]
