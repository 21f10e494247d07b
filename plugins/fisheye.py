"""`fisheye`: sensor of a fisheye picture in one of three projections."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.checks import checked

WIDEST = {"hemispherical": 180.0, "equidistant": 360.0, "equisolid": 360.0}
"""Largest angle across a picture by its mapping [deg]."""


def _edge(mapping: str, angle: float) -> float:
    """Distance ρ of the picture's edge from its centre [–], of the angle across it [deg]."""
    half = np.radians(angle) / 2
    return {
        "hemispherical": np.sin(half), "equidistant": half, "equisolid": 2 * np.sin(half / 2),
    }[mapping]  # fmt: skip


class Fisheye(mi.Sensor):
    """Fisheye camera without lens: radiance along the directions of its pixels.

    The distance ρ of a direction from the centre of the picture follows from its angle θ to the
    camera's axis: sin θ (`hemispherical`, Radiance's `-vth`), θ (`equidistant`, `-vta`) or
    2 sin(θ/2) (`equisolid`, pixels of equal solid angle).

    ===================  ===========  ===========================================================
    parameter            type         meaning
    ===================  ===========  ===========================================================
    `mapping`            string       `hemispherical`, `equidistant` (default) or `equisolid`
    `angle`              float        angle across the picture [deg], default 180; up to 180
                                      where it is hemispherical, else to 360
    `angle_up`           float        angle up the picture [deg], default `angle`
    `to_world`           transform    place of the camera, which looks along its +z, +y up, as
                                      with `perspective`; differentiable
    `film`, `sampler`    plugins      as with any sensor
    `shutter_open`, …    float        as with any sensor
    ===================  ===========  ===========================================================

    Corners that no direction leads to stay black; where the mapping reaches beyond `angle`, they
    show what is there, as in Radiance. Pixels mean radiance, not light on the film: weight them by
    their solid angles for illuminance. Spectral variants sample the visible wavelengths. `ptracer`
    cannot use the camera, since it traces light from emitters.
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        self.mapping = str(props.get("mapping", "equidistant"))
        if self.mapping not in WIDEST:
            raise ValueError(f"fisheye: mapping: {self.mapping!r}; give one of {', '.join(WIDEST)}")
        widest = WIDEST[self.mapping]
        angle = checked("fisheye", "angle", props.get("angle", 180.0), 1e-3, widest)
        up = checked("fisheye", "angle_up", props.get("angle_up", angle), 1e-3, widest)
        self.edges = mi.ScalarVector2f(*(_edge(self.mapping, float(a)) for a in (angle, up)))
        self.axes = self.world_transform()
        self.m_needs_sample_2 = True
        self.m_needs_sample_3 = False
        film = self.film()
        size = mi.ScalarVector2f(film.size())
        self.scale = mi.ScalarVector2f(film.crop_size()) / size
        self.offset = mi.ScalarVector2f(film.crop_offset()) / size
        self.step = 1 / size

    def traverse(self, cb):
        super().traverse(cb)
        cb.put("to_world", self.axes, mi.ParamFlags.Differentiable | mi.ParamFlags.Discontinuous)

    def _local(self, place):
        """Direction that a place of the whole picture shows, and whether there is one.

        `place`: over width and height from the upper left corner [–].
        """
        u = self.edges.x * (2 * place.x - 1)
        v = self.edges.y * (1 - 2 * place.y)
        rho = dr.sqrt(u * u + v * v)
        if self.mapping == "hemispherical":
            exists = rho <= 1
            aside = mi.Float(1)
            along = dr.safe_sqrt(1 - rho * rho)
        elif self.mapping == "equidistant":
            exists = rho <= dr.pi
            aside = dr.select(rho > 1e-4, dr.sin(rho) / dr.maximum(rho, 1e-4), 1)
            along = dr.cos(rho)
        else:
            exists = rho <= 2
            aside = dr.safe_sqrt(1 - rho * rho / 4)
            along = 1 - rho * rho / 2
        local = mi.Vector3f(-u * aside, v * aside, along)  # seen from behind, +x is to the left
        return dr.select(exists, local, mi.Vector3f(0, 0, 1)), exists

    def _ray(self, place, time, wavelengths):
        local, exists = self._local(place)
        ray = dr.zeros(mi.RayDifferential3f)
        ray.o = self.axes @ mi.Point3f(0)
        ray.d = dr.normalize(self.axes @ local)
        ray.maxt = dr.largest(mi.Float)
        ray.time = time
        ray.wavelengths = wavelengths
        return ray, exists

    def _sample(self, time, sample1, sample2, active):
        wavelengths, weight = self.sample_wavelengths(
            dr.zeros(mi.SurfaceInteraction3f), sample1, active
        )
        place = mi.Point2f(sample2) * self.scale + self.offset
        ray, exists = self._ray(place, time, wavelengths)
        return ray, dr.select(exists & active, weight, 0), place

    def sample_ray(self, time, sample1, sample2, sample3, active=True):
        ray, weight, _ = self._sample(time, sample1, sample2, active)
        return mi.Ray3f(ray), weight

    def sample_ray_differential(self, time, sample1, sample2, sample3, active=True):
        ray, weight, place = self._sample(time, sample1, sample2, active)
        right, _ = self._ray(place + mi.Vector2f(self.step.x, 0), time, ray.wavelengths)
        down, _ = self._ray(place + mi.Vector2f(0, self.step.y), time, ray.wavelengths)
        ray.o_x, ray.o_y, ray.d_x, ray.d_y = right.o, down.o, right.d, down.d
        ray.has_differentials = True
        return ray, weight

    def bbox(self):
        return mi.ScalarBoundingBox3f()

    def to_string(self):
        return f"Fisheye[{self.mapping}]"


mi.register_sensor("fisheye", Fisheye)
