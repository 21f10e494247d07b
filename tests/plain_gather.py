"""The gather as plainly as it can be written: the reference that `transport.gather` is held to."""

import drjit as dr
import mitsuba as mi
import numpy as np


def plain_gather(scene, point, normal, *, paths, bounces, seed):
    """Diffuse vertices of the paths of one sensor: no cells, roulette, blocks or even sequences.

    Parameters
    ----------
    scene : Scene
    point, normal : array_like, shape (3,)
        Position [m] and unit normal of the sensor.
    paths, bounces : int
        Number of paths, and of surfaces that each is followed to.
    seed : int

    Returns
    -------
    p, n : np.ndarray, shape (vertex, 3)
        Positions [m] and normals on the side that was met.
    weight : np.ndarray, shape (vertex,)
        Irradiance on the vertex times this is its share of the sensor's illuminance.
    """
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, paths)
    d = mi.Frame3f(mi.Normal3f(*map(float, normal))).to_world(
        mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    )
    ray, beta, vertices = mi.Ray3f(mi.Point3f(*map(float, point)), d), mi.Float(1), []
    for _ in range(bounces):
        si = scene.full.ray_intersect(ray)
        uv = sampler.next_2d()
        bs, weight = si.bsdf().sample(mi.BSDFContext(), si, sampler.next_1d(), uv, si.is_valid())
        beta = dr.select(si.is_valid(), beta * weight[0], 0)
        diffuse = mi.has_flag(bs.sampled_type, mi.BSDFFlags.DiffuseReflection)
        facing = dr.select(dr.dot(si.n, ray.d) < 0, si.n, -si.n)
        kept, p = dr.select(diffuse, beta, 0) / paths, si.p
        ray = si.spawn_ray(si.to_world(bs.wo))
        sampler.schedule_state()
        dr.eval(p, facing, kept, ray, beta)
        met = kept.numpy() > 0
        vertices.append([column.numpy().T[met] for column in (p, facing, kept)])
    return tuple(np.concatenate(column) for column in zip(*vertices, strict=True))
