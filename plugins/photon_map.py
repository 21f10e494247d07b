"""`photon_map`: photons from sky and suns, stored where they land; radiance is their density."""

from __future__ import annotations

import warnings

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.checks import checked, checked_whole
from drcmitsuba_plugins.photon_flight import Ledger, Photons, SensorDisks, facing, is_diffuse
from drcmitsuba_plugins.photon_grid import KERNELS, PhotonGrid
from drcmitsuba_plugins.photon_sources import PhotonBins, Ports, Surroundings, UnitSources
from drcmitsuba_plugins.symbolic import symbolic
from drcmitsuba_plugins.tables import table_of


class PhotonMap(mi.ad.integrators.common.ADIntegrator):
    r"""Photon map: photons carry flux to diffuse surfaces, whose radiance follows from its density.

    ===================  =======  =================================================================
    parameter            type     meaning
    ===================  =======  =================================================================
    `photons`            int      photons that are sent out in every pass, default 1,000,000
    `radius`             float    radius of the density estimate [m]; default 1 % of the scene's
    `passes`             int      passes with new photons and a smaller radius each, default 1
    `alpha`              float    how fast the radius shrinks: 1 not at all, default 0.7
    `gather`             int      rays of the final gather at each vertex, default 0: none
    `kind`               string   "global" (default), or "caustic": a picture of the light alone
                                  that met no diffuse surface before the one that is seen
    `kernel`             string   "epanechnikov" (default) or "constant"
    `ports`              tensor   shape (n, 4, 3), rectangles q0 … q3 that light goes in through,
                                  along (q1 − q0) × (q3 − q0); default: a disk round the scene
    `max_depth`          int      largest number of scattering events of a photon, and of a ray on
                                  its way to a diffuse surface; −1 for no limit, default 1000
    `rr_depth`           int      scattering events before Russian roulette begins, default 4
    ===================  =======  =================================================================

    Photons start from the scene's environment and `sun_disks`. They are stored wherever they land
    on a diffuse surface (one with a diffuse reflection lobe and no transmission; everything else is
    sampled: mirrors, dielectrics, panes and films, smooth or rough). A ray from the camera is
    followed by sampling to the first diffuse surface, where

    .. math:: L(x, \omega_o) = \sum_{|x_p - x| < r} f(\omega_p, \omega_o) \, \Phi_p
        K_r(x_p - x) , \qquad r_{i+1}^2 = r_i^2 \, \frac{i + \alpha}{i + 1} \quad\text{in pass } i.

    Only photons on the same side of the same surface count: normals within 26°, no further than
    r/5 off the tangent plane. With `gather`, the sum takes the photons that met no diffuse surface
    before; the rest comes by sampled rays, followed to the next diffuse surface, where all photons
    count. Light that these rays receive straight from a source is left out, as photons have brought
    it. So each path of light is counted once. The reflection in a coated diffuse surface is
    followed as in a mirror; photons reflected by the coat have met no diffuse surface there.

    `ledger` holds the ledger of the last call. Roulette keeps a photon with a probability equal to
    its weight at the event: stored photons have similar flux, and the mean flux is unchanged.

    Bias: light is spread by r, and an edge of a surface is too dark within r of it; both shrink
    with the passes (Knaus and Zwicker 2011): variance as N^−α, bias of light as N^(α−1). Limits:
    mono and rgb variants; no gradients, no participating media, no emitters but those; light
    through ports only if it comes straight to them, so that no port may stand behind another; one
    Fresnel-weighted lobe is blurred by r where a diffuse surface is glossy too.

    References: Jensen (1996), *Global illumination using photon maps*; Hachisuka and Jensen (2008),
    *Progressive photon mapping*, ACM Trans. Graph. 27(5), 130; Knaus and Zwicker (2011),
    *Progressive photon mapping: a probabilistic approach*, ACM Trans. Graph. 30(3), 25; shading
    normals: Veach (1997), section 5.3.
    """

    def __init__(self, props: mi.Properties):
        if mi.is_spectral or mi.is_polarized:
            raise ValueError(f"photon_map: variant {mi.variant()}; use a mono or rgb one")
        numbers = {}
        for name, default, least in (
            ("max_depth", 1000, -1), ("rr_depth", 4, 1), ("photons", 1_000_000, 1),
            ("passes", 1, 1), ("gather", 0, 0),
        ):  # fmt: skip
            numbers[name] = checked_whole("photon_map", name, props.get(name, default), least)
        super().__init__(props)
        for name, number in numbers.items():
            setattr(self, name, number)
        self.alpha = float(checked("photon_map", "alpha", props.get("alpha", 0.7), 0, 1))
        self.radius = float(checked("photon_map", "radius", props.get("radius", 0.0), 0))
        for name, choices in (("kind", ("global", "caustic")), ("kernel", KERNELS)):
            value = props.get(name, choices[0])
            if value not in choices:
                raise ValueError(f"photon_map: {name}: {value!r}; give {' or '.join(choices)}")
            setattr(self, name, value)
        if self.kind == "caustic" and self.gather > 0:
            raise ValueError("photon_map: gather: caustic photons need none; give 0")
        ports = props.get("ports")
        self.ports = (
            None if ports is None else Ports(table_of("photon_map", "ports", ports).numpy())
        )
        self.ledger: Ledger | None = None

    def radii(self, scene) -> list[float]:
        """Radius of the density estimate in every pass.

        Parameters
        ----------
        scene : mi.Scene

        Returns
        -------
        list of float
            [m].
        """
        box = scene.bbox()
        fallback = 0.01 * 0.5 * float(np.linalg.norm(box.extents())) if box.valid() else 0.01
        radii = [self.radius or fallback]
        for i in range(1, self.passes):
            radii.append(radii[-1] * np.sqrt((i + self.alpha) / (i + 1)))
        return radii

    def shoot(self, scene, photons: int, seed: int = 0):
        """Send photons with the radiances of the scene's sources.

        Parameters
        ----------
        scene : mi.Scene
        photons, seed : int

        Returns
        -------
        Store, Ledger
            Photons where they landed, and the balance of their flux.

        Raises
        ------
        ValueError
            The scene is empty, has no light source, or has one that sends no photons.
        """
        sources = PhotonBins(scene)
        return self._photons(scene, sources, []).send(photons, seed)

    def _photons(self, scene, sources, points):
        """Photons of sources, aimed at the ports, or at the whole scene and further points."""
        aim = self.ports or Surroundings(scene, points)
        return Photons(scene, sources, aim, self.max_depth, self.rr_depth)

    def sensors(self, scene, points, normals, photons: int, seed: int = 0):
        """Coefficients C of illuminance at points, from photons that cross a disk round each.

        Every bin has unit radiance and an equal share of the photons. With `gather`, light that met
        a diffuse surface comes instead from the photons at the ends of rays from the points.

        Parameters
        ----------
        scene : mi.Scene
        points, normals : array_like, shape (sensor, 3)
            Positions [m] and unit normals.
        photons : int
            Number of photons of all passes together; time is proportional to photons times sensors.
        seed : int

        Returns
        -------
        mi.TensorXd, shape (2, sensor, bin)
            C [sr], first channel: light that met no diffuse surface, and light that met one. Unlike
            `coefficient`, a glossy mirror is none, and a coat reflects like a mirror.
        """
        points, normals = np.asarray(points, float), np.asarray(normals, float)
        sources, radii = UnitSources(scene), self.radii(scene)
        spheres = points[:, None] + np.outer([-1, 1], radii[0] * np.ones(3))
        photons_of = self._photons(scene, sources, spheres)
        total, ledgers, start = 0, [], seed * self.passes  # no two seeds share a pass
        for i, radius in enumerate(radii):
            receivers = SensorDisks(points, normals, sources.bin_count, self.kernel, radius)
            count = max(photons // self.passes, 1)
            store, ledger = photons_of.send(count, start + i, receivers)
            ledgers.append(ledger)
            if self.gather:
                self._gather_at(scene, receivers, PhotonGrid(store, radius, self.kernel), start + i)
            total = total + receivers.out
        self._report(ledgers)
        shape = (2, len(points), sources.bin_count)
        return mi.TensorXd(total / self.passes, shape)

    def _gather_at(self, scene, receivers, grid, seed):
        """Replace the light that met a diffuse surface by the light at rays from the sensors."""
        part, rows = receivers.count * receivers.bins, receivers.count * self.gather
        later = dr.arange(mi.UInt32, 2 * part) >= part
        receivers.out = dr.select(later, 0, receivers.out)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed + (1 << 20), rows)
        row = dr.arange(mi.UInt32, rows) // self.gather
        p, n = (dr.gather(mi.Vector3f, a, row) for a in (receivers.points, receivers.normals))
        d = mi.Frame3f(n).to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
        base = part + row * receivers.bins

        def collect(si, bsdf, beta, active):
            def add(i, density, near):
                light = beta * _reflected(grid, si, bsdf, i, near) * density
                bin = dr.gather(mi.UInt32, grid.bin, i, near)
                dr.scatter_add(receivers.out, mi.Float64(light[0]), base + bin, near)
                return mi.Spectrum(0)

            grid.sum(si.p, facing(si), active, add)
            return mi.Spectrum(0)

        self._follow(
            scene, sampler, mi.Ray3f(mi.Point3f(p), d), mi.Spectrum(dr.pi / self.gather), collect,
            None, mi.Bool(True),
        )  # fmt: skip

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        if isinstance(sensor, int):
            sensor = scene.sensors()[sensor]
        spp = spp or sensor.sampler().sample_count()
        image, ledgers, start = 0, [], int(seed) * self.passes
        for i, radius in enumerate(self.radii(scene)):
            store, ledger = self.shoot(scene, self.photons, start + i)
            ledgers.append(ledger)
            self._grid = PhotonGrid(store, radius, self.kernel)
            image = image + super().render(
                scene, sensor, start + i + (1 << 21), -(-spp // self.passes), develop, evaluate
            )
        del self._grid
        self._report(ledgers)
        return image / self.passes

    def sample(self, mode, scene, sampler, ray, active=True, **_):
        """Radiance along camera rays; see `mi.ad.integrators.common.ADIntegrator.sample`."""
        if mode != dr.ADMode.Primal:
            raise RuntimeError("photon_map: it has no gradients; use coefficient, or prb")
        grid = self._grid

        def at_diffuse(si, bsdf, beta, active):
            return self._at_diffuse(scene, sampler, grid, si, bsdf, beta, active)

        sources = None if self.kind == "caustic" else PhotonBins(scene)
        L = self._follow(
            scene, sampler, mi.Ray3f(ray), mi.Spectrum(1), at_diffuse, sources, mi.Bool(active)
        )
        return L, scene.ray_test(mi.Ray3f(ray), active), [], None

    @symbolic
    def _at_diffuse(self, scene, sampler, grid, si, bsdf, beta, active):
        """Radiance of a diffuse surface times the rays' weight, by all photons or final gather."""
        undiffused = self.kind == "caustic" or self.gather > 0
        light = _density(grid, si, bsdf, beta, active, undiffused)

        def onward_light(si, bsdf, beta, active):
            return _density(grid, si, bsdf, beta, active, False)

        k, rays = mi.UInt32(0), dr.opaque(mi.UInt32, self.gather)
        while active & (k < rays):
            bs, weight = bsdf.sample(
                mi.BSDFContext(), si, sampler.next_1d(active), sampler.next_2d(active), active
            )
            scattered = active & ~mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            ray = si.spawn_ray(si.to_world(bs.wo))
            share = beta * weight / mi.Float(rays)
            light += self._follow(scene, sampler, ray, share, onward_light, None, scattered)
            k += 1
        return light

    @symbolic
    def _follow(self, scene, sampler, ray, beta, at_diffuse, sources, active):
        """Radiance along rays from the first diffuse surface that they meet, times their weight.

        Parameters
        ----------
        beta : mi.Spectrum
            Weight of the rays.
        at_diffuse : callable
            `at_diffuse(si, bsdf, beta, active)` returns the weighted radiance of a diffuse surface.
        sources : Sources or None
            Sources that rays see where they leave the scene.

        Returns
        -------
        mi.Spectrum
        """
        ctx = mi.BSDFContext()
        light, depth = mi.Spectrum(0), mi.UInt32(0)
        ray, beta, active = mi.Ray3f(ray), mi.Spectrum(beta), mi.Bool(active)
        while active:
            si = scene.ray_intersect(ray, mi.RayFlags.All, coherent=False, active=active)
            if dr.hint(sources is not None, mode="scalar"):
                light += beta * sources.seen(ray.d, active & ~si.is_valid())
            active &= si.is_valid()
            bsdf = si.bsdf(ray)
            diffuse = active & is_diffuse(bsdf)
            light += at_diffuse(si, bsdf, beta, diffuse)
            bs, weight = bsdf.sample(
                ctx, si, sampler.next_1d(active), sampler.next_2d(active), active
            )
            active &= ~diffuse | mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            beta *= weight
            share = dr.minimum(dr.max(weight), 1)
            chance = dr.select(depth >= self.rr_depth, share, 1)
            active &= (sampler.next_1d(active) < chance) & dr.any(beta > 0)
            beta /= chance
            ray = si.spawn_ray(si.to_world(bs.wo))
            depth += 1
            if dr.hint(self.max_depth >= 0, mode="scalar"):
                active &= depth < self.max_depth
        return light

    def _report(self, ledgers):
        """Keep the mean ledger, and warn where flux was lost."""
        self.ledger = ledger = Ledger.mean(ledgers)
        if ledger.lost > 1e-3 * ledger.emitted:
            share = ledger.lost / ledger.emitted
            message = f"photon_map: {share:.1%} of the flux lost; raise max_depth"
            # Mitsuba's log reaches neither a notebook nor a user who lowered its level.
            warnings.warn(message, RuntimeWarning, stacklevel=3)

    def to_string(self):
        return f"PhotonMap[photons={self.photons}, passes={self.passes}, gather={self.gather}]"


def _reflected(grid, si, bsdf, i, active):
    """Radiance along the ray of `si` per irradiance density of photon `i`, f Φ."""
    wo = si.to_local(dr.gather(mi.Vector3f, grid.towards, i, active))
    value = bsdf.eval(mi.BSDFContext(), si, wo, active)
    cosine = dr.abs(wo.z)
    f = dr.select(cosine > 1e-6, value / cosine, 0)
    return f * dr.gather(mi.Spectrum, grid.flux, i, active)


def _density(grid, si, bsdf, beta, active, undiffused):
    """Weighted radiance by photon density; `undiffused`: photons that met no diffuse surface."""

    def light(i, density, near):
        if undiffused:
            near = near & ~dr.gather(mi.Bool, grid.met, i, near)
        return dr.select(near, _reflected(grid, si, bsdf, i, near) * density, 0)

    return beta * mi.Spectrum(grid.sum(si.p, facing(si), active, light))


mi.register_integrator("photon_map", PhotonMap)
