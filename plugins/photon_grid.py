"""Stored photons, sorted into a grid of cells, and sums over the photons near a point."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

KERNELS = ("epanechnikov", "constant")


def kernel_density(kernel: str, distance2, radius2):
    """Kernel K(d) = 2 (1 − d²/r²) / (π r²), whose integral over the disk is 1.

    Parameters
    ----------
    kernel : str
        "epanechnikov" as above, or "constant", 1 / (π r²).
    distance2, radius2 : mi.Float
        Squares of the distance d from the centre and of the disk's radius r [m²].

    Returns
    -------
    mi.Float
        [1/m²].
    """
    inside = distance2 < radius2
    shape = 2 - 2 * distance2 / radius2 if kernel == "epanechnikov" else mi.Float(1)
    return dr.select(inside, shape * dr.inv_pi / radius2, 0)


class Store:
    """Stored photons; `count` is the number of photons offered, which may exceed `capacity`.

    Attributes
    ----------
    position, towards, normal : mi.Point3f, mi.Vector3f, mi.Normal3f
        Point where a photon landed [m], direction to its origin, normal on the side of arrival.
    flux : mi.Spectrum
        Flux [W or lm]; [m² sr] per unit radiance.
    bin : mi.UInt32
        Bin of the photon's source.
    met : mi.Bool
        True where the photon had met a diffuse surface before.
    """

    FIELDS = ("position", "towards", "normal", "flux", "bin", "met")

    def __init__(self, capacity: int):
        self.capacity = dr.opaque(mi.UInt32, capacity)  # opaque: one kernel for all sizes
        self.position = dr.zeros(mi.Point3f, capacity)
        self.towards = dr.zeros(mi.Vector3f, capacity)
        self.normal = dr.zeros(mi.Normal3f, capacity)
        self.flux = dr.zeros(mi.Spectrum, capacity)
        self.bin = dr.zeros(mi.UInt32, capacity)
        self.met = dr.zeros(mi.Bool, capacity)
        self._counter = dr.zeros(mi.UInt32, 1)

    def keep(self, active, **photon):
        """Keep the photons of the active lanes; callable in symbolic loops."""
        slot = dr.scatter_inc(self._counter, mi.UInt32(0), active)
        fits = active & (slot < self.capacity)
        for name in self.FIELDS:
            dr.scatter(getattr(self, name), photon[name], slot, fits)

    @property
    def count(self) -> int:
        return int(self._counter[0])


class PhotonGrid:
    """Photons sorted by the cells of a regular grid.

    The cells' edge is the radius: photons within the radius of a point lie in nine rows of three
    cells, and each row is a run of the sorted list, located by bisection. There is no table of
    cells, so a small radius in a large scene needs no memory.

    Parameters
    ----------
    store : Store
        Photons.
    radius : float
        Largest distance at which a photon counts [m].
    kernel : str
        See `kernel_density`.
    """

    COMPATIBLE = 0.9
    """Least cosine between the normals of a photon and of a point for which it counts."""
    FLAT = 0.2
    """Largest distance from the tangent plane [radii]: a table is not the floor below it."""
    MOST_CELLS = 1 << 31

    def __init__(self, store: Store, radius: float, kernel: str):
        self.position: mi.Point3f
        self.normal: mi.Normal3f
        self.kernel = kernel
        self.count = store.count
        self.radius = dr.opaque(mi.Float, radius)
        if self.count == 0:
            return
        photons = dr.arange(mi.UInt32, self.count)
        position = dr.gather(mi.Point3f, store.position, photons)
        low = np.array([float(dr.min(x)[0]) for x in position])
        extent = np.array([float(dr.max(x)[0]) for x in position]) - low
        edge = 1.0001 * radius  # rounding leaves no neighbour two cells away
        while np.prod(np.floor(extent / edge) + 3) > self.MOST_CELLS:
            edge *= 1.3
        self.low = mi.Point3f(*(dr.opaque(mi.Float, float(x)) for x in low))
        self.edge = dr.opaque(mi.Float, edge)
        # One more cell on each side: every photon's cell has neighbours.
        self.size = [dr.opaque(mi.UInt32, int(n)) for n in np.floor(extent / edge) + 3]
        keys = self._key(*self._cell(position))
        order = dr.argsort(keys)
        # Filled up to a power of two with the largest key: one kernel for similar counts.
        self.keys = dr.full(mi.UInt32, 0xFFFFFFFF, 1 << self.count.bit_length())
        dr.scatter(self.keys, dr.gather(mi.UInt32, keys, order), photons)
        for name in Store.FIELDS:
            field = getattr(store, name)
            setattr(self, name, dr.gather(type(field), field, order))
        dr.eval(self.keys, *(getattr(self, name) for name in Store.FIELDS))

    def _cell(self, p):
        """Indices of the cell that holds a point; for a point outside, of the nearest cell."""
        x = (p - self.low) / self.edge + 1
        return [mi.UInt32(dr.clip(c, 1, n - 2)) for c, n in zip(x, self.size, strict=True)]

    def _key(self, x, y, z):
        return x + self.size[0] * (y + self.size[1] * z)

    def _first_from(self, key, last):
        """Index of the first photon whose cell is `key` or a later one."""
        return mi.UInt32(
            dr.binary_search(0, last, lambda k: dr.gather(mi.UInt32, self.keys, k) < key)
        )

    @symbolic
    def sum(self, p, n, active, light):
        """Kernel-weighted sum over the photons near a point, on the same side of its surface.

        Parameters
        ----------
        p, n : mi.Point3f, mi.Normal3f
            Point [m] and normal of its surface, on the side that is asked for.
        active : mi.Bool
        light : callable
            `light(index, density, near)` returns a photon's summand, a spectrum; `density` is the
            kernel's value [1/m²], zero where not `near`.

        Returns
        -------
        list of mi.Float64
            One sum per channel.
        """
        total = [mi.Float64(0) for _ in range(len(mi.Spectrum()))]
        if dr.hint(self.count > 0, mode="scalar"):
            x, y, z = self._cell(p)
            radius2 = dr.square(self.radius)
            row, last = mi.UInt32(0), len(self.keys) - 1
            while active & (row < 9):
                first = self._key(x - 1, y + row % 3 - 1, z + row // 3 - 1)
                i = self._first_from(first, last)
                inside = active & (dr.gather(mi.UInt32, self.keys, i, active) <= first + 2)
                while inside:
                    d = dr.gather(mi.Point3f, self.position, i, inside) - p
                    d2 = dr.squared_norm(d)
                    facing = dr.dot(dr.gather(mi.Normal3f, self.normal, i, inside), n)
                    flat = dr.abs(dr.dot(d, n)) < self.FLAT * self.radius
                    near = inside & (d2 < radius2) & flat & (facing > self.COMPATIBLE)
                    density = dr.select(near, kernel_density(self.kernel, d2, radius2), 0)
                    value = light(i, density, near)
                    for c in range(len(total)):
                        total[c] += mi.Float64(value[c])
                    i += 1
                    inside = inside & (dr.gather(mi.UInt32, self.keys, i, inside) <= first + 2)
                row += 1
        return total
