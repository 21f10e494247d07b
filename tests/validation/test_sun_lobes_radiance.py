"""Suns and an even sky by way of a rough mirror, against the rough `metal` of Radiance.

The wall with a window and the mirror of `test_image_suns_radiance`. With `rtrace -ab 1` rays of the
receivers meet the metal, whose highlights of the sun Radiance computes directly.
"""

import numpy as np
import pytest

from drcmitsuba.model.materials import Lambertian, MirrorMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.scene.scene import build
from drcmitsuba.transport.mirrors.sun_lobes import SunLobes
from drcmitsuba.transport.rays.shadow_rays import sky_deposit, sun_deposit
from tests import radiance, skips
from tests.validation.test_image_suns_radiance import (
    DIAMETER,
    NORMALS,
    OPPOSITE,
    POINTS,
    RHO,
    WALL,
    polygon,
    suns,
)

pytestmark = skips.RADIANCE.mark
AGAIN, TIMES = 512, 4
OPTIONS = "-h -I -ab 1 -ad 16384 -lw 1e-7 -aa 0 -dj 1 -ds 0.01 -dt 0 -dc 1 -dr 0 -ss 1 -st 0"


def rtraced(folder, alpha, sources):
    """Irradiance of the points by sources, shape (point,)."""
    text = f"void metal m 0 0 5 {RHO} {RHO} {RHO} 1 {alpha}\nvoid plastic black 0 0 5 0 0 0 0 0\n"
    text += polygon("m", "opposite", OPPOSITE[::-1])
    text += "".join(polygon("black", f"wall{i}", q) for i, q in enumerate(WALL))
    (folder / "scene.rad").write_text(text + sources)
    (folder / "scene.oct").write_bytes(radiance.run(["oconv", "scene.rad"], folder))
    lines = "\n".join(" ".join(map(str, row)) for row in np.hstack([POINTS, NORMALS])) + "\n"
    command = ["rtrace", *OPTIONS.split(), "scene.oct"]
    out = radiance.run(command, folder, (lines * TIMES).encode(), 100).decode()
    numbers = np.array([row.split()[1] for row in out.splitlines()], float)
    return numbers.reshape(TIMES, -1).mean(axis=0)


@pytest.mark.slow
@pytest.mark.parametrize(("alpha", "within"), [(0.05, 0.03), (0.15, 0.04), (0.3, 0.08)])
def test_rough_mirrors_send_what_radiances_metal_sends(tmp_path, alpha, within):
    """Facets of Beckmann's distribution differ from Ward's lobe by 1, 2 and 6 %.

    Of one sun, all points together, the shapes differ by up to 19 % at a roughness of 0.3.
    """
    backend.select()
    metal = MirrorMaterial(type="mirror", reflectance=RHO, roughness=alpha, distribution="beckmann")
    scene = build(
        [
            Surface("mirror", metal, OPPOSITE[None], "mirror"),
            Surface("wall", Lambertian(0.0), np.array(WALL)),
        ]
    )
    (lobes,) = SunLobes.of(scene)
    p, n = (flat(np.repeat(x, AGAIN, axis=0)) for x in (POINTS, NORMALS))
    some = suns()[::3]

    def mean(D):
        return D.numpy().reshape(len(POINTS), AGAIN, -1).mean(axis=1)

    light = {"suns": some, "diameter": DIAMETER, "seed": 0}
    straight = mean(sun_deposit(scene, p, n, samples=2, **light))
    ours = mean(lobes.suns(p, n, samples=8, **light))
    theirs = np.zeros_like(ours)
    for k, d in enumerate(some):
        at = " ".join(map(str, d))
        sun = f"void light s 0 0 3 1 1 1\ns source sun 0 0 4 {at} {DIAMETER}\n"
        theirs[:, k] = rtraced(tmp_path, alpha, sun) - straight[:, k]
    assert ours.sum() == pytest.approx(theirs.sum(), rel=within)
    lit = ours.sum(axis=0) > 0.02 * ours.sum()
    assert lit.sum() >= 5
    np.testing.assert_allclose(ours.sum(axis=0)[lit], theirs.sum(axis=0)[lit], rtol=0.22)

    kind = {"subdivision": 1, "rays": 1024, "seed": 0}
    even = mean(sky_deposit(scene, p, n, **kind)).sum(axis=1)
    mirrored = mean(lobes.sky(p, n, **kind)).sum(axis=1)
    whole = rtraced(tmp_path, alpha, "void glow g 0 0 4 1 1 1 0\ng source s 0 0 4 0 0 1 360\n")
    np.testing.assert_allclose(even + mirrored, whole, rtol=0.01)
