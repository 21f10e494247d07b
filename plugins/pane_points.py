"""Points on the panes of a scene that scatter what they let through."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np


class PanePoints:
    """All panes with a smooth transmission lobe, as one area from which points are drawn.

    Parameters
    ----------
    scene : mi.Scene

    Attributes
    ----------
    shapes : list of mi.ShapePtr
        The panes; an empty list makes the object false.
    area : float
        Area of all of them [m²].
    """

    def __init__(self, scene):
        def scatters(flags):
            smooth = mi.has_flag(flags, mi.BSDFFlags.Smooth)
            return smooth and mi.has_flag(flags, mi.BSDFFlags.Transmission)

        shapes = [s for s in scene.shapes() if s.bsdf() is not None and scatters(s.bsdf().flags())]
        self.shapes = [mi.ShapePtr(shape) for shape in shapes]
        # Called here, as a mesh builds its table of areas at the first call.
        areas = [float(np.ravel(shape.surface_area())[0]) for shape in shapes]
        self.area = sum(areas)
        self.cumulated = np.cumsum(areas) / (self.area or 1)

    def __bool__(self) -> bool:
        return bool(self.shapes)

    def sample(self, u, uv, active):
        """Pane and point on it, drawn uniformly by area.

        Parameters
        ----------
        u, uv : mi.Float, mi.Point2f
            Uniform random numbers in [0, 1).
        active : mi.Bool

        Returns
        -------
        mi.ShapePtr, mi.PositionSample3f
        """
        shape = mi.ShapePtr(self.shapes[-1])
        for share, earlier in zip(self.cumulated[-2::-1], self.shapes[-2::-1], strict=True):
            shape = dr.select(u < float(share), earlier, shape)
        return shape, shape.sample_position(0.0, uv, active)

    def density(self, origin, p, n):
        """Density, by solid angle seen from `origin`, of the points `p` with normals `n` [1/sr]."""
        d = p - origin
        r2 = dr.squared_norm(d)
        cosine = dr.abs(dr.dot(n, d)) * dr.rsqrt(r2)
        return dr.select(cosine > 0, r2 / (cosine * self.area), dr.inf)
