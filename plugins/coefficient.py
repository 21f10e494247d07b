"""`coefficient`: unbiased path tracing of daylight coefficients C, one per bin of sky and suns."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.bin_sums import BinSums, RowSums
from drcmitsuba_plugins.checks import checked_whole
from drcmitsuba_plugins.filter_sampling import FilterSampling
from drcmitsuba_plugins.pane_points import PanePoints
from drcmitsuba_plugins.sampling import on_disk, sample_disk, transmittance
from drcmitsuba_plugins.symbolic import symbolic

_NO_GRADIENTS = (
    "there are no gradients but C itself, the derivative by the radiances; use prb for others"
)


class Coefficient(mi.ad.integrators.common.ADIntegrator):
    r"""Path tracer that sums the light of every bin of the scene's sky and suns separately.

    The bins are those of the scene's `tregenza_sky` followed by those of its `sun_disks`, each
    with unit radiance; the radiances of these emitters are not used. Any other environment (such as
    `envmap` with a continuous sky) is one bin and keeps its radiance.

    ===================  ======  ==================================================================
    parameter            type    meaning
    ===================  ======  ==================================================================
    `max_depth`          int     largest number of scattering events, −1 (default) for no limit
    `rr_depth`           int     scattering events before Russian roulette begins, default 4
    `suns_per_vertex`    int     suns that are sampled at a diffuse vertex, default 4
    `suns_per_pane`      int     suns that are sampled at a pane that scatters, default 4
    ===================  ======  ==================================================================

    As an integrator it renders a tensor (height, width, bin) [1] of ∂L/∂L_bin over the film's crop
    window: every sample belongs to one pixel, its position is drawn from the film's reconstruction
    filter. The film itself stays empty. `sample` gives the radiance along rays under bins of unit
    radiance, all together; `sensors` gives ∂E/∂L_bin [sr] at points,

    .. math:: C_b = \int_{\Omega} \frac{\partial L_i(\omega)}{\partial L_b} \cos\theta \, d\omega .

    Sky: emitter sampling (uniform over the sphere) and BSDF sampling, combined by the balance
    heuristic. Suns: emitter sampling; after a perfectly specular event the disks themselves are
    tested. Behind a pane that scatters, points on the panes and BSDF sampling are combined
    likewise. Shadow rays pass panes with a `Null` component and are weighted by their
    transmittance. Every estimate is unbiased; sums are kept in Float64.

    Gradients: C *is* the derivative of radiance and illuminance by the bins' radiances. Other
    derivatives raise an error, as the loops would silently give 0: `sensors` in a scene with a
    parameter that tracks gradients, `sample` in any mode but `Primal`, and the derivative of
    `mi.render`. For derivatives by materials, take Mitsuba's `prb` with the bins' radiances.

    Limits: first channel of the spectrum only; no participating media; light that reaches a pane
    only by mirrors is noisy for suns.
    """

    def __init__(self, props: mi.Properties):
        numbers = {}
        for name, default, least in (
            ("max_depth", -1, -1), ("rr_depth", 4, 1), ("suns_per_vertex", 4, 1),
            ("suns_per_pane", 4, 1),
        ):  # fmt: skip
            numbers[name] = checked_whole("coefficient", name, props.get(name, default), least)
        super().__init__(props)
        for name, number in numbers.items():
            setattr(self, name, number)

    @staticmethod
    def _sources(scene):
        """Environment and suns of the scene; either may be None."""
        suns = [e for e in scene.emitters() if type(e).__name__ == "SunDisks"]
        sky = scene.environment()
        if sky is None and not suns:
            raise ValueError("coefficient: the scene has neither an environment nor sun_disks")
        return sky, suns[0] if suns else None

    @staticmethod
    def _sky_bins(sky) -> int:
        """Number of the environment's bins: 1 if it is no `tregenza_sky`, 0 without environment."""
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
        """Number of bins of the scene's sky and suns."""
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
            C [sr] of light that met no diffuse surface (a pane is not one), and of light that did.

        Raises
        ------
        ValueError
            The scene has no source of light.
        RuntimeError
            A parameter of the scene tracks gradients.
        """
        for name, value in mi.traverse(scene):
            if dr.grad_enabled(value):
                raise RuntimeError(f"coefficient: {name} tracks gradients; {_NO_GRADIENTS}")
        rows = len(points)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, rows * spp)
        lane = dr.arange(mi.UInt32, rows * spp)
        row = lane // dr.opaque(mi.UInt32, spp)  # opaque: one kernel for all counts
        p = dr.gather(mi.Point3f, mi.Float(np.asarray(points, np.float32).ravel()), row)
        n = dr.gather(mi.Normal3f, mi.Float(np.asarray(normals, np.float32).ravel()), row)
        # The sensor is a white Lambertian vertex: E = π L, with L the radiance it would reflect.
        si = dr.zeros(mi.SurfaceInteraction3f, rows * spp)
        si.p, si.n, si.sh_frame = p, n, mi.Frame3f(n)
        wo = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
        white = mi.load_dict({"type": "diffuse", "reflectance": {"type": "uniform", "value": 1.0}})
        si.wi = mi.Vector3f(0, 0, 1)
        sums = BinSums(rows, self.bin_count(scene))
        beta = dr.opaque(mi.Float, np.pi / spp)
        everywhere = dr.full(mi.Bool, True, rows * spp)
        first = np.random.default_rng(seed).integers(1 << 31)
        base, panes = sums.base(row), PanePoints(scene)
        self._sky_sampling(scene, sampler, si, white, beta, sums, base, everywhere)
        self._sun_sampling(
            scene, sampler, si, white, beta, sums, base, everywhere,
            turn=lane * self.suns_per_vertex + dr.opaque(mi.UInt32, int(first)),
        )  # fmt: skip
        if self.max_depth != 0:  # a pane is the first event
            self._pane_sampling(scene, panes, sampler, si, white, beta, sums, base, everywhere)
        ray = mi.Ray3f(p, si.to_world(wo))
        pdf = mi.warp.square_to_cosine_hemisphere_pdf(wo)
        self._trace(scene, panes, sampler, ray, beta, pdf, mi.Bool(False), base, sums)
        return sums.tensor()

    def sample(self, mode, scene, sampler, ray, active=True, **_):
        """Radiance along rays where every bin has unit radiance.

        The parameters are those of `mi.ad.integrators.common.ADIntegrator.sample`.

        Returns
        -------
        L : mi.Spectrum
            [1], the same in all channels.
        valid : mi.Bool
            True where the ray meets a surface.
        aovs, state : list, None
            Empty.
        """
        if mode != dr.ADMode.Primal:
            raise RuntimeError(f"coefficient: mode {mode}; {_NO_GRADIENTS}")
        lanes = dr.width(ray.d)
        sums, lane = RowSums(lanes), dr.arange(mi.UInt32, lanes)
        start = dr.select(active, mi.Float(1), 0)
        self._trace_from_camera(scene, sampler, ray, start, lane, sums)
        light = mi.Float(dr.sum(sums.tensor(), axis=0).array)
        return mi.Spectrum(light), scene.ray_test(mi.Ray3f(ray), active), [], None

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        """∂L/∂L_bin [1] of the crop window's pixels: mi.TensorXf, shape (height, width, bin)."""
        if not develop:
            raise ValueError("coefficient: develop=False; its picture is a tensor, not a film's")
        if isinstance(sensor, int):
            sensor = scene.sensors()[sensor]
        width, height = map(int, sensor.film().crop_size())
        with dr.suspend_grad():
            sampler, spp = self.prepare(sensor, seed, spp, self.aov_names())
            ray, weight, share, pixel = self.sample_rays(scene, sensor, sampler)
            sums = BinSums(width * height, self.bin_count(scene), share)
            self._trace_from_camera(scene, sampler, ray, weight[0] / spp, pixel, sums)
            image = mi.TensorXf(dr.sum(sums.tensor(), axis=0))
            return dr.reshape(image, (height, width, sums.bins))

    def render_forward(self, scene, params, sensor=0, seed=0, spp=0):
        raise RuntimeError(f"coefficient: {_NO_GRADIENTS}")

    def render_backward(self, scene, params, grad_in, sensor=0, seed=0, spp=0):
        raise RuntimeError(f"coefficient: {_NO_GRADIENTS}")

    def sample_rays(self, scene, sensor, sampler):
        """Rays of all pixels of the crop window, one per sample of the sampler and pixel.

        Returns
        -------
        ray : mi.RayDifferential3f
        weight : mi.Spectrum
            Response of the sensor.
        share : mi.Float
            Weight of the sample in its pixel, mean 1; negative in a negative lobe of the filter.
        pixel : mi.UInt32
            Number of the ray's pixel, row by row.
        """
        film = sensor.film()
        width, height = map(int, film.crop_size())
        spp = sampler.sample_count()
        pixel = dr.arange(mi.UInt32, width * height * spp) // dr.opaque(mi.UInt32, spp)
        centre = mi.Point2f(mi.Float(pixel % width), mi.Float(pixel // width)) + 0.5
        offset, share = FilterSampling(film.rfilter()).sample(sampler.next_2d())
        time = sensor.shutter_open()
        if sensor.shutter_open_time() > 0:
            time += sampler.next_1d() * sensor.shutter_open_time()
        wavelength = sampler.next_1d() if mi.is_spectral else 0
        aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0)
        position = (centre + offset) / mi.Point2f(width, height)
        ray, weight = sensor.sample_ray_differential(time, wavelength, position, aperture)
        return ray, weight, share, pixel

    def _trace_from_camera(self, scene, sampler, ray, beta, row, sums):
        """Follow rays from the camera, whose origin has no emitter sampling."""
        self._trace(
            scene, PanePoints(scene), sampler, mi.Ray3f(ray), beta, mi.Float(1), mi.Bool(True),
            sums.base(row), sums,
        )  # fmt: skip

    def _sky_sampling(self, scene, sampler, si, bsdf, beta, sums, base, active):
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
        sums.add(base, at, light, lit)

    def _sun_sampling(self, scene, sampler, si, bsdf, beta, sums, base, active, turn=None):
        """Add the light that reaches a vertex straight from sampled suns.

        Suns are drawn at random; or, from the random number `turn` on, one after the other, so that
        each has its share of the lanes.
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
            sums.add(base, first + sun, light, lit)

    def _pane_sampling(self, scene, panes, sampler, si, bsdf, beta, sums, base, active):
        """Add the suns' light that reaches a diffuse vertex from a point on the panes.

        BSDF sampling meets the panes too: the balance heuristic weights both.
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
        self._suns_on_pane(scene, sampler, on_pane, shape.bsdf(), weight, sums, base, seen)

    @symbolic
    def _suns_on_pane(self, scene, sampler, si, bsdf, beta, sums, base, active):
        """Add the suns' light that a pane scatters at a vertex on it.

        A pane may scatter a sun into few directions only: suns are drawn in proportion to their
        light in this direction, so each lane adds the sum over all suns, or 0 in shadow.
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
            sums.add(base, first + sun, beta * total * tau * share, lit)

    @staticmethod
    @symbolic
    def _add_suns_seen(suns, first, d, beta, sums, base, active):
        """Add light to every sun whose disk holds direction `d`; the suns of a year overlap."""
        sun = mi.UInt32(0)
        searching = mi.Bool(active)
        while searching & (sun < suns.bin_count):
            hit = on_disk(d, suns.direction_of(sun, searching), suns.diameter)
            sums.add(base, first + sun, beta, searching & hit)
            sun += 1

    @symbolic
    def _trace(self, scene, panes, sampler, ray, beta, pdf, delta, base, sums):
        """Follow paths and add the light that they collect to `sums`.

        `pdf` is the density of the ray's direction at the last vertex that scatters, `origin` that
        vertex. `delta` is true where emitter sampling cannot draw this direction, `looked` where
        points on the panes were sampled from `origin`; `base` is the row's first entry in `sums`.
        """
        sky, suns = self._sources(scene)
        ctx = mi.BSDFContext()
        first = self._sky_bins(sky)
        beta, pdf, delta, base = mi.Float(beta), mi.Float(pdf), mi.Bool(delta), mi.UInt32(base)
        origin, looked = mi.Point3f(ray.o), ~delta
        start = mi.Float(beta)
        depth = mi.UInt32(0)
        active = mi.Bool(True)
        while active:
            si = scene.ray_intersect(ray, mi.RayFlags.All, coherent=False, active=active)
            escaped = active & ~si.is_valid()
            if dr.hint(sky is not None, mode="scalar"):
                mis = dr.select(delta, 1, pdf / (pdf + dr.inv_four_pi))
                at, radiance = self._sky_bin(sky, ray.d, escaped)
                sums.add(base, at, beta * mis * radiance, escaped)
            if dr.hint(suns is not None, mode="scalar"):
                self._add_suns_seen(suns, first, ray.d, beta, sums, base, escaped & delta)
            active &= si.is_valid()
            if dr.hint(self.max_depth >= 0, mode="scalar"):
                active &= depth < self.max_depth
            bsdf = si.bsdf(ray)
            flags = bsdf.flags()
            scatters = active & mi.has_flag(flags, mi.BSDFFlags.Smooth)
            is_pane = mi.has_flag(flags, mi.BSDFFlags.Transmission)
            meets_diffuse = scatters & ~is_pane
            base = dr.select(meets_diffuse & (base < sums.part), base + sums.part, base)
            self._sky_sampling(scene, sampler, si, bsdf, beta, sums, base, scatters)
            self._sun_sampling(scene, sampler, si, bsdf, beta, sums, base, meets_diffuse)
            if dr.hint(bool(panes) and suns is not None, mode="scalar"):
                other = panes.density(origin, si.p, si.n)
                share = dr.select(looked, pdf / (pdf + other), 1)
                at_pane = scatters & is_pane
                self._suns_on_pane(scene, sampler, si, bsdf, beta * share, sums, base, at_pane)
            goes_on = mi.Bool(meets_diffuse)
            if dr.hint(self.max_depth >= 0, mode="scalar"):
                goes_on &= depth + 1 < self.max_depth
            self._pane_sampling(scene, panes, sampler, si, bsdf, beta, sums, base, goes_on)
            bs, weight = bsdf.sample(
                ctx, si, sampler.next_1d(active), sampler.next_2d(active), active
            )
            beta *= weight[0]
            ray = si.spawn_ray(si.to_world(bs.wo))
            null = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
            mirrored = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            # A pane crossed straight does not change the last vertex's sampling; emitter sampling
            # does not cover a mirrored path.
            pdf = dr.select(null | mirrored, pdf, bs.pdf)
            delta = dr.select(null, delta, mirrored)
            origin = dr.select(null | mirrored, origin, si.p)
            looked = dr.select(null, looked, meets_diffuse & ~mirrored)
            depth += 1
            # A roulette limit of 0.95 for any reflectance gave unbounded variance in white rooms.
            survival = dr.clip(beta / start, 0.05, 0.999)
            roulette = depth >= self.rr_depth
            survives = ~roulette | (sampler.next_1d(active) < survival)
            beta = dr.select(roulette, beta / survival, beta)
            active &= survives & (beta > 0)

    def to_string(self):
        return f"Coefficient[max_depth={self.max_depth}]"


mi.register_integrator("coefficient", Coefficient)
