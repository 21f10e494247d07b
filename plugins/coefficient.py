"""`coefficient`: unbiased path tracing of daylight coefficients, one per light source and bin."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.checks import checked_whole
from drcmitsuba_plugins.sampling import on_disk, sample_disk, transmittance


class _Panes:
    """The panes of a scene that scatter what they let through, as one area to draw points on."""

    def __init__(self, scene):
        def scatters(flags):
            smooth = mi.has_flag(flags, mi.BSDFFlags.Smooth)
            return smooth and mi.has_flag(flags, mi.BSDFFlags.Transmission)

        shapes = [s for s in scene.shapes() if s.bsdf() is not None and scatters(s.bsdf().flags())]
        self.shapes = [mi.ShapePtr(shape) for shape in shapes]
        # Asked for here, as a mesh makes its table of areas at the first call.
        areas = [float(np.ravel(shape.surface_area())[0]) for shape in shapes]
        self.area = sum(areas)
        self.shares = np.cumsum(areas) / self.area if shapes else []

    def __bool__(self) -> bool:
        return bool(self.shapes)

    def sample(self, which, uv, active):
        """Pane and point on it, evenly by area, from random numbers."""
        shape = mi.ShapePtr(self.shapes[-1])
        for share, earlier in zip(self.shares[-2::-1], self.shapes[-2::-1], strict=True):
            shape = dr.select(which < float(share), earlier, shape)
        return shape, shape.sample_position(0.0, uv, active)

    def density(self, origin, p, n):
        """Density, by solid angle seen from `origin`, of the points `p` with normals `n` [1/sr]."""
        d = p - origin
        r2 = dr.squared_norm(d)
        cosine = dr.abs(dr.dot(n, d)) * dr.rsqrt(r2)
        return dr.select(cosine > 0, r2 / (cosine * self.area), dr.inf)


class Coefficient(mi.CppADIntegrator):
    r"""Path tracer that keeps the light of every bin of the scene's sky and suns apart.

    The bins are those of the scene's `tregenza_sky` followed by those of its `sun_disks`, each
    with unit radiance; the radiances of these emitters play no part. Any other environment (such as
    `envmap` with a continuous sky) is one bin with the radiance that it has.

    ===================  ======  ==================================================================
    parameter            type    meaning
    ===================  ======  ==================================================================
    `max_depth`          int     largest number of scattering events, −1 (default) for no limit
    `rr_depth`           int     scattering events before Russian roulette begins, default 4
    `suns_per_vertex`    int     suns that are sampled at a diffuse vertex, default 4
    `suns_per_pane`      int     suns that are sampled at a pane that scatters, default 4
    ===================  ======  ==================================================================

    As an integrator it renders a tensor (height, width, bin) [1] of ∂L/∂L_bin with a box filter.
    `sensors` gives ∂E/∂L_bin [sr] at points,

    .. math:: C_b = \int_{\Omega} \frac{\partial L_i(\omega)}{\partial L_b} \cos\theta \, d\omega .

    Sky: emitter sampling (uniform over the sphere) and BSDF sampling, combined by the balance
    heuristic. Suns: emitter sampling; after a perfectly specular event the disks themselves are
    tested. By way of a pane that scatters, they are sought from points on the panes and by BSDF
    sampling, combined likewise. Shadow rays pass panes with a `Null` component by their
    transmittance. Every estimate is unbiased; sums are kept in Float64.

    Limits: first channel of the spectrum only; no participating media; light that reaches a pane
    only by mirrors is noisy for suns.
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        for name, default, least in (
            ("max_depth", -1, -1), ("rr_depth", 4, 0), ("suns_per_vertex", 4, 1),
            ("suns_per_pane", 4, 1),
        ):  # fmt: skip
            setattr(self, name, checked_whole("coefficient", name, props.get(name, default), least))

    @staticmethod
    def _sources(scene):
        """The scene's environment and suns; either may be None."""
        suns = [e for e in scene.emitters() if type(e).__name__ == "SunDisks"]
        sky = scene.environment()
        if sky is None and not suns:
            raise ValueError("coefficient: the scene has neither an environment nor sun_disks")
        return sky, suns[0] if suns else None

    @staticmethod
    def _sky_bins(sky) -> int:
        """Bins of the environment: those of a `tregenza_sky`, one of any other, none of none."""
        return 0 if sky is None else getattr(sky, "bin_count", 1)

    @staticmethod
    def _sky_bin(sky, d, active):
        """Bin and radiance of the environment in world directions `d`."""
        if hasattr(sky, "bin_of"):
            return sky.bin_of(d), mi.Float(1)
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = -d
        return mi.UInt32(0), sky.eval(si, active)[0]

    @classmethod
    def bin_count(cls, scene) -> int:
        """Number of bins of a scene: those of the sky, then the suns."""
        sky, suns = cls._sources(scene)
        return cls._sky_bins(sky) + (0 if suns is None else suns.bin_count)

    def sensors(self, scene, points, normals, spp: int, seed: int = 0):
        """Coefficients of illuminance at points.

        Parameters
        ----------
        scene : mi.Scene
        points, normals : array_like, shape (sensor, 3)
            Positions [m] and unit normals.
        spp : int
            Paths from every point.
        seed : int

        Returns
        -------
        mi.TensorXd, shape (2, sensor, bin)
            C [sr]: light that met no diffuse surface (panes are none), and light that met one.
        """
        rows = len(points)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, rows * spp)
        lane = dr.arange(mi.UInt32, rows * spp)
        row = lane // dr.opaque(mi.UInt32, spp)  # other counts need no other kernel
        p = dr.gather(mi.Point3f, mi.Float(np.asarray(points, np.float32).ravel()), row)
        n = dr.gather(mi.Normal3f, mi.Float(np.asarray(normals, np.float32).ravel()), row)
        # The sensor is a white Lambertian vertex: E = π L of what it would reflect.
        si = dr.zeros(mi.SurfaceInteraction3f, rows * spp)
        si.p, si.n, si.sh_frame = p, n, mi.Frame3f(n)
        wo = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
        white = mi.load_dict({"type": "diffuse", "reflectance": {"type": "uniform", "value": 1.0}})
        si.wi = mi.Vector3f(0, 0, 1)
        bins = self.bin_count(scene)
        out = dr.zeros(mi.Float64, 2 * rows * bins)
        beta = dr.opaque(mi.Float, np.pi / spp)
        everywhere = dr.full(mi.Bool, True, rows * spp)
        first = np.random.default_rng(seed).integers(1 << 31)
        base, panes = row * bins, _Panes(scene)
        self._sky_sampling(scene, sampler, si, white, beta, out, base, everywhere)
        self._sun_sampling(
            scene, sampler, si, white, beta, out, base, everywhere,
            turn=lane * self.suns_per_vertex + dr.opaque(mi.UInt32, int(first)),
        )  # fmt: skip
        self._pane_sampling(scene, panes, sampler, si, white, beta, out, base, everywhere)
        ray = mi.Ray3f(p, si.to_world(wo))
        pdf = mi.warp.square_to_cosine_hemisphere_pdf(wo)
        self._trace(scene, panes, sampler, ray, beta, pdf, mi.Bool(False), base, rows * bins, out)
        return mi.TensorXd(out, (2, rows, bins))

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        if isinstance(sensor, int):
            sensor = scene.sensors()[sensor]
        width, height = sensor.film().crop_size()
        spp = spp or sensor.sampler().sample_count()
        bins, pixels = self.bin_count(scene), int(width) * int(height)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(int(seed), pixels * spp)
        row = dr.arange(mi.UInt32, pixels * spp) // spp
        corner = mi.Point2f(mi.Float(row % int(width)), mi.Float(row // int(width)))
        position = (corner + sampler.next_2d()) / mi.Point2f(float(width), float(height))
        ray, weight = sensor.sample_ray(
            0.0, sampler.next_1d(), position, sampler.next_2d(), mi.Bool(True)
        )
        out = dr.zeros(mi.Float64, 2 * pixels * bins)
        self._trace(
            scene, _Panes(scene), sampler, mi.Ray3f(ray), weight[0] / spp, mi.Float(1),
            mi.Bool(True), row * bins, pixels * bins, out,
        )  # fmt: skip
        parts = dr.reshape(mi.TensorXd(out, (2, pixels * bins)), (2, -1))
        image = mi.TensorXf(dr.sum(parts, axis=0))
        return dr.reshape(image, (int(height), int(width), bins))

    def _sky_sampling(self, scene, sampler, si, bsdf, beta, out, base, active):
        """Add the light that reaches a vertex straight from a sampled direction of the sky."""
        sky, _ = self._sources(scene)
        if sky is None:
            return
        d = mi.warp.square_to_uniform_sphere(sampler.next_2d(active))
        value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(d), active)
        lit = active & (value[0] > 0)
        tau = transmittance(scene, si.spawn_ray(d), lit)
        # value / pdf_sky · pdf_sky / (pdf_sky + pdf_bsdf)
        at, radiance = self._sky_bin(sky, d, lit)
        light = beta * value[0] * tau * radiance / (dr.inv_four_pi + pdf)
        dr.scatter_add(out, mi.Float64(light), base + at, lit)

    def _sun_sampling(self, scene, sampler, si, bsdf, beta, out, base, active, turn=None):
        """Add the light that reaches a vertex straight from sampled suns.

        They are drawn at random, or, from a number `turn` on that is random itself, in turn: then
        each of them has its share of the lanes.
        """
        sky, suns = self._sources(scene)
        if suns is None:
            return
        ctx, first = mi.BSDFContext(), self._sky_bins(sky)
        share = suns.bin_count * suns.solid_angle / self.suns_per_vertex
        for i in range(self.suns_per_vertex):
            if turn is None:
                u = sampler.next_1d(active) * suns.bin_count
                sun = dr.minimum(mi.UInt32(u), suns.bin_count - 1)
            else:
                sun = (turn + i) % suns.bin_count
            centre = suns.direction_of(sun, active)
            d = sample_disk(centre, suns.diameter, sampler.next_2d(active))
            value = bsdf.eval(ctx, si, si.to_local(d), active)[0]
            lit = active & (value > 0)
            tau = transmittance(scene, si.spawn_ray(d), lit)
            light = beta * value * tau * share
            dr.scatter_add(out, mi.Float64(light), base + first + sun, lit)

    def _pane_sampling(self, scene, panes, sampler, si, bsdf, beta, out, base, active):
        """Add the suns' light that reaches a diffuse vertex from a point on the panes.

        BSDF sampling finds the panes too: each counts by its share of both densities.
        """
        if not panes or self._sources(scene)[1] is None:
            return
        shape, ps = panes.sample(sampler.next_1d(active), sampler.next_2d(active), active)
        ray = si.spawn_ray_to(ps.p)
        value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(ray.d), active)
        seen = active & (value[0] > 0)
        tau = transmittance(scene, ray, seen)
        # value / pdf_pane · pdf_pane / (pdf_pane + pdf_bsdf)
        weight = beta * value[0] * tau / (panes.density(si.p, ps.p, ps.n) + pdf)
        on_pane = dr.zeros(mi.SurfaceInteraction3f, dr.width(ps.p))
        on_pane.p, on_pane.n, on_pane.sh_frame = ps.p, ps.n, mi.Frame3f(ps.n)
        on_pane.wi = on_pane.to_local(-ray.d)
        seen &= weight > 0
        self._suns_on_pane(scene, sampler, on_pane, shape.bsdf(), weight, out, base, seen)

    @dr.syntax
    def _suns_on_pane(self, scene, sampler, si, bsdf, beta, out, base, active):
        """Add the suns' light that a pane scatters at a vertex on it.

        A pane may send a sun into few directions only: suns are drawn in proportion to what they
        send into this one, so that what is added is the sum over all suns, or nothing in shadow.
        """
        sky, suns = self._sources(scene)
        ctx, first = mi.BSDFContext(), self._sky_bins(sky)
        total = mi.Float(0)
        drawn = [mi.UInt32(0) for _ in range(self.suns_per_pane)]
        towards = [mi.Vector3f(0, 0, 1) for _ in range(self.suns_per_pane)]
        sun, searching = mi.UInt32(0), mi.Bool(active)
        while searching & (sun < suns.bin_count):
            centre = suns.direction_of(sun, searching)
            d = sample_disk(centre, suns.diameter, sampler.next_2d(searching))
            value = bsdf.eval(ctx, si, si.to_local(d), searching)[0]
            total += value
            for i in range(len(drawn)):
                takes = sampler.next_1d(searching) * total < value
                drawn[i] = dr.select(takes, sun, drawn[i])
                towards[i] = dr.select(takes, d, towards[i])
            sun += 1
        share = suns.solid_angle / self.suns_per_pane
        for sun, d in zip(drawn, towards, strict=True):
            lit = active & (total > 0)
            tau = transmittance(scene, si.spawn_ray(d), lit)
            dr.scatter_add(out, mi.Float64(beta * total * tau * share), base + first + sun, lit)

    @staticmethod
    @dr.syntax
    def _add_suns_seen(suns, d, beta, out, base, active):
        """Add to every sun whose disk holds direction `d`; the suns of a year overlap."""
        sun = mi.UInt32(0)
        searching = mi.Bool(active)
        while dr.hint(searching & (sun < suns.bin_count), exclude=[out]):
            hit = on_disk(d, suns.direction_of(sun, searching), suns.diameter)
            dr.scatter_add(out, mi.Float64(beta), base + sun, searching & hit)
            sun += 1

    @dr.syntax
    def _trace(self, scene, panes, sampler, ray, beta, pdf, delta, base, part, out):
        """Follow paths and add what they collect to `out`.

        `pdf` is the density of the ray's direction at the last vertex that scatters, `delta` says
        that no emitter sampling could have found it; `base` is the first entry of the lane's row,
        `part` the offset of the part that has met a diffuse surface. `origin` is that vertex, and
        `looked` says whether points on the panes were sampled from it.
        """
        sky, suns = self._sources(scene)
        ctx = mi.BSDFContext()
        first = self._sky_bins(sky)
        beta, pdf, delta, base = mi.Float(beta), mi.Float(pdf), mi.Bool(delta), mi.UInt32(base)
        origin, looked = mi.Point3f(ray.o), ~delta
        start = mi.Float(beta)
        depth = mi.UInt32(0)
        active = mi.Bool(True)
        while dr.hint(active, exclude=[out]):
            si = scene.ray_intersect(ray, mi.RayFlags.All, coherent=False, active=active)
            escaped = active & ~si.is_valid()
            if dr.hint(sky is not None, mode="scalar"):
                mis = dr.select(delta, 1, pdf / (pdf + dr.inv_four_pi))
                at, radiance = self._sky_bin(sky, ray.d, escaped)
                dr.scatter_add(out, mi.Float64(beta * mis * radiance), base + at, escaped)
            if dr.hint(suns is not None, mode="scalar"):
                self._add_suns_seen(suns, ray.d, beta, out, base + first, escaped & delta)
            active &= si.is_valid()
            bsdf = si.bsdf(ray)
            flags = bsdf.flags()
            scatters = active & mi.has_flag(flags, mi.BSDFFlags.Smooth)
            is_pane = mi.has_flag(flags, mi.BSDFFlags.Transmission)
            meets_diffuse = scatters & ~is_pane
            base = dr.select(meets_diffuse & (base < part), base + part, base)
            self._sky_sampling(scene, sampler, si, bsdf, beta, out, base, scatters)
            self._sun_sampling(scene, sampler, si, bsdf, beta, out, base, meets_diffuse)
            if dr.hint(bool(panes) and suns is not None, mode="scalar"):
                other = panes.density(origin, si.p, si.n)
                share = dr.select(looked, pdf / (pdf + other), 1)
                at_pane = scatters & is_pane
                self._suns_on_pane(scene, sampler, si, bsdf, beta * share, out, base, at_pane)
            goes_on = mi.Bool(meets_diffuse)
            if dr.hint(self.max_depth >= 0, mode="scalar"):
                goes_on &= depth + 1 < self.max_depth
            self._pane_sampling(scene, panes, sampler, si, bsdf, beta, out, base, goes_on)
            bs, weight = bsdf.sample(
                ctx, si, sampler.next_1d(active), sampler.next_2d(active), active
            )
            beta *= weight[0]
            ray = si.spawn_ray(si.to_world(bs.wo))
            null = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
            mirrored = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            # A pane crossed straight leaves the last vertex's sampling as it was; a mirrored path
            # is out of reach of emitter sampling.
            pdf = dr.select(null | mirrored, pdf, bs.pdf)
            delta = dr.select(null, delta, mirrored)
            origin = dr.select(null | mirrored, origin, si.p)
            looked = dr.select(null, looked, meets_diffuse & ~mirrored)
            depth += 1
            # Below 0.95 whatever the reflectance, the variance had no end in white rooms.
            survival = dr.clip(beta / start, 0.05, 0.999)
            roulette = depth >= self.rr_depth
            survives = ~roulette | (sampler.next_1d(active) < survival)
            beta = dr.select(roulette, beta / survival, beta)
            active &= survives & (beta > 0)
            if dr.hint(self.max_depth >= 0, mode="scalar"):
                active &= depth < self.max_depth

    def to_string(self):
        return f"Coefficient[max_depth={self.max_depth}]"


mi.register_integrator("coefficient", Coefficient)
