"""Radiance scene descriptions, views and sensors, read without Radiance.

read
    Scene files as a model.
read_views, read_points
    Views of a `.vf` file, sensors of a `.pts` file.

text, usage, command, context
    Words of a file and of a command line; commands without a shell; how much a reading may take.
reading, compiled
    Files with those that they call for; compiled meshes by the files that they were made from.
definitions, patterns, materials, glazing, films
    Materials with their modifiers, as those of the engine.
expression, functional, bodies, generators, xform
    Arithmetic; surfaces, bodies, and what generators make of them; transforms.
polygons, surfaces, model, views
    Polygons and facets by their modifier; layers; views and sensors.
"""

from drcmitsuba.model.radiance.model import read
from drcmitsuba.model.radiance.views import read_points, read_views

__all__ = ["read", "read_points", "read_views"]
