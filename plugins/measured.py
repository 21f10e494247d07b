"""Base of the plugins `tensor_tree` and `klems`: lobes, sampling, the straight-through peak."""

from __future__ import annotations

import functools
import operator
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins import bsdf_file, energy, peak
from drcmitsuba_plugins.checks import checked, checked_whole, required
from drcmitsuba_plugins.measured_hooks import Lobes
from drcmitsuba_plugins.sampling import (
    directions_of,
    pane_axes,
    pane_to_local,
    to_pane,
    valid_directions,
)

COMPONENTS = ("tf", "tb", "rf", "rb")


class Measured(mi.BSDF):
    """BSDF of a file; subclasses provide `MeasuredHooks`, the methods for their kind of file.

    ====================  =======  ================================================================
    parameter             type     meaning
    ====================  =======  ================================================================
    `filename`            string   LBNL BSDF XML
    `up`                  vector   world direction of the file's y axis, default +z; it is
                                   projected on the pane
    `level`               vector   the same on a pane that is horizontal, default +y
    `straight_through`    string   'auto' (default): a straight-through peak above noise becomes
                                   a view through the pane; 'on': any cell above its neighbours
                                   does; 'off': none does
    `flip`                bool     the file's front faces the room (turned about the y axis);
                                   default false: its back does, as the format defines
    `turn`                bool     upside down (turned by 180° about the normal), default false
    `channel`             int      −1 (default): luminance; 0, 1, 2: red, green, blue of a file
                                   with chromaticity
    `mix`                 vector   weights of red, green and blue, whose sum takes the place of
                                   the luminance, in a band of the spectrum for instance; or a
                                   number, a factor of the luminance
    ====================  =======  ================================================================

    The shading normal points into the room. `leaves` [1/sr] and `through` are exposed through
    `traverse` and differentiable. Sampling is exactly proportional to f cos θ: the weight is the
    albedo (for isotropic trees in `Radiance` mode 0 to 2 times the albedo). Files need not be
    reciprocal: in `TransportMode.Radiance` light enters along `wo`, in `Importance` along `wi`. A
    missing transmission follows from the other by reciprocity.
    T + R of 1 to 1.05 is scaled down to 1; `largest_albedo` is the largest T + R of the file.

    Limits: one value for all channels of the variant.
    """

    plugin = "measured"

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        self.up, self.level = directions_of(self.plugin, props)
        mode = props.get("straight_through", "auto")
        if mode not in ("auto", "on", "off"):
            raise ValueError(f"{self.plugin}: straight_through: {mode!r}; give auto, on or off")
        # Mounting turns by 180°, so it is three signs of the axes and its own inverse.
        flip, turn = (-1.0 if props.get(name, False) else 1.0 for name in ("flip", "turn"))
        self.signs = (flip * turn, turn, flip)
        channel = checked_whole(self.plugin, "channel", props.get("channel", -1), -1, 2)
        filename = required(self.plugin, props, "filename", "the path of a BSDF file")
        try:
            # A relative path may also start at the scene file's folder.
            file = bsdf_file.read(str(mi.file_resolver().resolve(filename))).of_channel(channel)
            if "mix" in props:
                mix = np.array(props["mix"], float).ravel()
                file = file.mixed(tuple(checked(self.plugin, "mix", mix, -np.inf)))
            file, self.largest_albedo = energy.scaled_to_conserve(file)
            self._load(file, mode)
        except bsdf_file.BsdfFileError as error:
            raise ValueError(f"{self.plugin}: {error}") from None
        except ValueError as error:
            raise ValueError(f"{self.plugin}: {filename}: {error}") from None
        both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide | mi.BSDFFlags.Anisotropic
        lobes = [mi.BSDFFlags.GlossyReflection | both, mi.BSDFFlags.GlossyTransmission | both]
        if self.has_view:
            lobes.append(mi.BSDFFlags.Null | both)
        self.m_components = lobes
        self.m_flags = functools.reduce(operator.or_, lobes)

    def _load(self, file, mode):
        """Number the leaves of all components, take the peaks out, and make the lobes."""
        self._check(file)
        rest, through = dict(file.components), {}
        for name in [n for n in COMPONENTS[:2] if n in rest]:
            part = peak.split(rest[name])
            if mode == "on" or (mode == "auto" and part.stands_out):
                rest[name], through[name] = part.rest, part.through
        numbered: list = []
        values: list[np.ndarray] = []
        self._swapped = [False] * len(COMPONENTS)
        for name in COMPONENTS:
            component = rest.get(name)
            if component is not None:
                first = sum(map(len, values))
                leaves = first + np.arange(component.value.size).reshape(component.value.shape)
                values.append(component.value.ravel())
                component = replace(component, value=leaves)
            numbered.append(component)
        for i, j in ((0, 1), (1, 0)):
            missing, other = COMPONENTS[i], COMPONENTS[j]
            if missing not in rest and other in rest:
                numbered[i], self._swapped[i] = self._reversed(numbered[j])
                if other in through:
                    through[missing] = self._reversed_view(through[other])
        views = [through.get(name, np.zeros(1)) for name in COMPONENTS[:2]]
        self.view_cells = max(len(view) for view in views)
        views = [np.repeat(v, self.view_cells // len(v)) for v in views]
        self.has_view = bool(through)
        self.through = mi.Float(np.concatenate(views).astype(np.float32))
        self.leaves = mi.Float(np.concatenate(values).astype(np.float32))
        self._numbered, self._lobes = numbered, {}
        self._make(mi.TransportMode.Radiance)

    def _make(self, mode) -> Lobes:
        """Lobes of a transport mode; made at the first call."""
        if mode not in self._lobes:
            fixed = "outgoing" if mode == mi.TransportMode.Radiance else "incident"
            lobes = self._lobes_of(self._numbered, self._swapped, fixed)
            lobes.update(dr.detach(self.leaves).numpy().astype(float))
            self._lobes[mode] = lobes
        return self._lobes[mode]

    def traverse(self, cb):
        for name in ("leaves", "through"):
            cb.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        for lobes in self._lobes.values():
            lobes.update(dr.detach(self.leaves).numpy().astype(float))

    def _to_file(self, si):
        """Axes x and y of the pane in the local frame; z is the same."""
        try:
            return pane_axes(si, self.up, self.level)
        except ValueError as error:
            raise ValueError(f"{self.plugin}: {error}") from None

    def mounted(self, w):
        """Direction of the pane's frame (+z into the room, +y up) in the file's, or the reverse."""
        return mi.Vector3f(w.x * self.signs[0], w.y * self.signs[1], w.z * self.signs[2])

    def _seen(self, w, axes):
        """Local direction in the file's frame."""
        return self.mounted(to_pane(w, axes))

    def _unseen(self, w, axes):
        """Direction of the file's frame in the local one."""
        return pane_to_local(self.mounted(w), axes)

    @property
    def out_cells(self) -> int:
        """Number of cells that a hemisphere of outgoing directions is cut into."""
        return self._make(mi.TransportMode.Radiance).out_cells

    @property
    def out_even(self) -> bool:
        """True where f is constant within each outgoing cell."""
        return self._make(mi.TransportMode.Radiance).out_even

    def out_cell(self, w):
        """Number of the cell that holds a direction of the pane's frame."""
        return self._make(mi.TransportMode.Radiance).out_cell(self.mounted(w))

    def out_direction(self, cell, uv, front):
        """Direction of the pane's frame, drawn from a cell, uniformly by projected solid angle."""
        w = self.mounted(self._make(mi.TransportMode.Radiance).out_direction(cell, uv))
        return mi.Vector3f(w.x, w.y, dr.select(front, 1, -1) * dr.abs(w.z))

    def leaf(self, si, wo):
        """Leaf of the file that holds f for light from `wo` to `si.wi`.

        Parameters
        ----------
        si : mi.SurfaceInteraction3f
        wo : mi.Vector3f
            Direction towards the light, in the local frame.

        Returns
        -------
        mi.UInt32
            Number of the leaf from 1; 0 where there is none, as for a peak that is a view.

        Notes
        -----
        Limits: 2²⁴ leaves.
        """
        axes = self._to_file(si)
        wi, wo = self._seen(si.wi, axes), self._seen(wo, axes)
        # Leaf numbers are looked up like values: float32 is exact up to 2²⁴.
        numbers = dr.arange(mi.Float, dr.width(self.leaves)) + 1
        component = self._component(mi.BSDFContext(), wi, wo)
        lobes = self._make(mi.TransportMode.Radiance)
        active = valid_directions(wi, wo)
        return mi.UInt32(lobes.value(numbers, component, wi, wo, active))

    @staticmethod
    def _component(ctx, wi, wo):
        """Number of the component that joins two directions."""
        incident = wo if ctx.mode == mi.TransportMode.Radiance else wi
        side = dr.select(incident.z > 0, mi.UInt32(0), 1)
        return side + dr.select(wi.z * wo.z > 0, mi.UInt32(2), 0)

    def _shares(self, ctx, si, wi, active):
        """Rows and albedos of reflection and transmission, and the straight-through part."""
        lobes = self._make(ctx.mode)
        mirror = mi.Vector3f(wi)
        behind = mi.Vector3f(wi.x, wi.y, -wi.z)
        rows = [lobes.row(self._component(ctx, wi, w), wi) for w in (mirror, behind)]
        names = ((mi.BSDFFlags.GlossyReflection, 0), (mi.BSDFFlags.GlossyTransmission, 1))
        albedos = [
            lobes.albedo(row, active) * ctx.is_enabled(*name)
            for row, name in zip(rows, names, strict=True)
        ]
        light = -wi if ctx.mode == mi.TransportMode.Radiance else wi
        tau = self._view(light, active) if self.has_view else mi.Float(0)
        return lobes, rows, albedos, tau * ctx.is_enabled(mi.BSDFFlags.Null, 2)

    def _view(self, light, active):
        """Transmittance of the undeviated ray for light from a direction of the file's frame."""
        at = self._view_cell(light) + dr.select(light.z > 0, 0, mi.UInt32(self.view_cells))
        return dr.gather(mi.Float, self.through, at, active)

    def eval_null_transmission(self, si, active=True):
        if not self.has_view:
            return mi.Spectrum(0)
        light = -self._seen(si.wi, self._to_file(si))
        return mi.Spectrum(self._view(light, active & valid_directions(light)))

    def _value(self, lobes, component, wi, wo, active):
        return lobes.value(self.leaves, component, wi, wo, active)

    def _pdf(self, lobes, rows, albedos, tau, wi, wo, value, active):
        """Density of the direction `wo` [1/sr], lobe choice included."""
        reflected = wi.z * wo.z > 0
        row = dr.select(reflected, rows[0], rows[1])
        own = dr.select(reflected, albedos[0], albedos[1])
        total = albedos[0] + albedos[1] + tau
        share = dr.select(total > 0, own / dr.select(total > 0, total, 1), 0)
        return share * lobes.density(row, wi, wo, value, active) * dr.abs(wo.z)

    def sample(self, ctx, si, sample1, sample2, active=True):
        axes = self._to_file(si)
        wi = self._seen(si.wi, axes)
        active = active & valid_directions(wi)
        lobes, rows, (reflect, transmit), tau = self._shares(ctx, si, wi, active)
        total = reflect + transmit + tau
        u = sample1 * total
        straight = u >= reflect + transmit
        reflected = u < reflect
        within = dr.select(reflected, u, u - reflect)
        u = within / dr.maximum(dr.select(reflected, reflect, transmit), 1e-30)
        row = dr.select(reflected, rows[0], rows[1])
        scatters = active & ~straight & (total > 0)
        wo = lobes.draw(row, wi, dr.minimum(u, dr.one_minus_epsilon(mi.Float)), sample2, scatters)
        wo.z = dr.select(reflected == (wi.z > 0), wo.z, -wo.z)
        value = self._value(lobes, self._component(ctx, wi, wo), wi, wo, scatters)
        pdf = dr.detach(self._pdf(lobes, rows, (reflect, transmit), tau, wi, wo, value, scatters))
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = dr.select(straight, -si.wi, self._unseen(wo, axes))
        bs.pdf = dr.select(straight, dr.detach(tau / dr.maximum(total, 1e-30)), pdf)
        bs.eta = 1.0
        kind = dr.select(reflected, mi.UInt32(0), dr.select(straight, mi.UInt32(2), 1))
        bs.sampled_component = kind
        flags = (mi.BSDFFlags.GlossyReflection, mi.BSDFFlags.GlossyTransmission, mi.BSDFFlags.Null)
        bs.sampled_type = dr.select(
            reflected, mi.UInt32(+flags[0]), dr.select(straight, mi.UInt32(+flags[2]), +flags[1])
        )
        active = active & (total > 0) & (bs.pdf > 0)
        weight = dr.select(straight, tau, value * dr.abs(wo.z)) / dr.select(active, bs.pdf, 1)
        return bs, mi.Spectrum(dr.select(active, weight, 0))

    def eval(self, ctx, si, wo, active=True):
        return self.eval_pdf(ctx, si, wo, active)[0]

    def pdf(self, ctx, si, wo, active=True):
        return self.eval_pdf(ctx, si, wo, active)[1]

    def eval_pdf(self, ctx, si, wo, active=True):
        axes = self._to_file(si)
        wi, wo = self._seen(si.wi, axes), self._seen(wo, axes)
        active = active & valid_directions(wi, wo)
        lobes, rows, albedos, tau = self._shares(ctx, si, wi, active)
        value = self._value(lobes, self._component(ctx, wi, wo), wi, wo, active)
        names = ((mi.BSDFFlags.GlossyReflection, 0), (mi.BSDFFlags.GlossyTransmission, 1))
        on = [mi.Float(ctx.is_enabled(*name)) for name in names]
        value *= dr.select(wi.z * wo.z > 0, on[0], on[1])
        pdf = dr.detach(self._pdf(lobes, rows, albedos, tau, wi, wo, value, active))
        f = dr.select(active, value * dr.abs(wo.z), 0)
        return mi.Spectrum(f), dr.select(active, pdf, 0)

    def to_string(self):
        return f"{type(self).__name__}[]"
