"""Mitsuba scenes that one kernel may trace together."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import mitsuba as mi
import numpy as np

from drcmitsuba.scene.meshes import mesh


def mitsuba_scene(shapes: Mapping[str, Any]) -> mi.Scene:
    """Scene of shapes and sources by name; kernels may trace it beside others made here.

    On a GPU, OptiX finds what a ray meets in a table, of which a kernel has one. Dr.Jit leaves out
    the rays in scenes with other tables and goes on, so all scenes share the table of one.
    """
    variant = str(mi.variant())
    shared = {"shared_table": _owner_of_table(variant)} if variant.startswith("cuda") else {}
    return mi.load_dict({"type": "scene", **shared, **shapes}, optimize=False)


@lru_cache(maxsize=8)  # more than there are variants: scenes of two owners share no table
def _owner_of_table(variant: str) -> mi.Scene:
    """Scene whose table Mitsuba extends for every scene that is made with it as a part."""
    triangle = mesh("triangle", np.eye(3), np.array([[0, 1, 2]]), None)
    return mi.load_dict({"type": "scene", "triangle": triangle}, optimize=False)
