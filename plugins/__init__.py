"""Mitsuba plugins of drcmitsuba, registered for every JIT variant.

Importing this package (as `import drcmitsuba` does) makes the plugins known to the variant that is
set and to each one that is set later. Mitsuba keeps one registry per variant, and the classes are
made anew for each: go by plugin name through `mi.load_dict`, never by class.

======================  ==========  ===============================================================
name                    kind        what it is
======================  ==========  ===============================================================
`tregenza_sky`          emitter     sky patches and ground, one radiance each
`sun_disks`             emitter     any number of suns of finite diameter
`glazing`               BSDF        thin clear pane with angular transmittance and reflectance
`coated_mirror`         BSDF        mirror below a clear layer
`polished`              BSDF        smooth surface that mirrors more at grazing incidence
`diffuser`              BSDF        thin Lambertian pane: sun shade, fabric, opal glass
`tensor_tree`           BSDF        measured pane or film: LBNL tensor tree, rank 3 or 4
`klems`                 BSDF        measured pane or film: LBNL Klems matrix
`redirecting_film`      BSDF        redirecting film of a few differentiable parameters
`coefficient`           integrator  unbiased path tracing of daylight coefficients
`photon_map`            integrator  photon map: caustics, and coefficients by a second route
`fisheye`               sensor      fisheye camera: hemispherical, equidistant, equisolid
======================  ==========  ===============================================================
"""

from __future__ import annotations

import importlib
import sys

import mitsuba as mi

_MODULES = (
    "tregenza_sky",
    "sun_disks",
    "glazing",
    "coated_mirror",
    "polished",
    "diffuser",
    "rows",
    "lobes",
    "isotropic",
    "measured",
    "tensor_tree",
    "klems",
    "redirecting_film",
    "coefficient",
    "photon_map",
    "fisheye",
)


_registered: set[str] = set()


def _register(*_variants: object) -> None:
    """Import the plugin modules for the current variant; their last lines register them.

    Once for each: Mitsuba keeps what a variant had when another one is set.
    """
    variant = mi.variant()
    if variant is None or variant.startswith("scalar") or variant in _registered:
        return  # a plugin in Python needs a vectorised variant
    for name in _MODULES:
        full = f"{__name__}.{name}"
        if full in sys.modules:
            importlib.reload(sys.modules[full])
        else:
            importlib.import_module(full)
    _registered.add(variant)


mi.detail.add_variant_callback(_register)
_register()
