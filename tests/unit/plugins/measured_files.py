"""BSDF files with random and with simple contents, and how the tests ask the plugins for them."""

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins import bsdf_file
from drcmitsuba_plugins.klems_basis import BASES

RADIANCE, IMPORTANCE = mi.TransportMode.Radiance, mi.TransportMode.Importance

HEAD = """<?xml version="1.0"?><WindowElement><Optical><Layer><DataDefinition>
<IncidentDataStructure>{kind}</IncidentDataStructure></DataDefinition>"""
BLOCK = """<WavelengthData><Wavelength>{wavelength}</Wavelength><WavelengthDataBlock>
<WavelengthDataDirection>{direction}</WavelengthDataDirection>
<ColumnAngleBasis>{basis}</ColumnAngleBasis><RowAngleBasis>{basis}</RowAngleBasis>
<ScatteringData>{data}</ScatteringData></WavelengthDataBlock></WavelengthData>"""
NAMES = {
    "tb": "Transmission Front",
    "tf": "Transmission Back",
    "rb": "Reflection Front",
    "rf": "Reflection Back",
}


def xml(kind, components, basis="LBNL/Shirley-Chiu", wavelength="Visible"):
    blocks = [
        BLOCK.format(direction=NAMES[n], data=data, basis=basis, wavelength=wavelength)
        for n, data in components.items()
    ]
    return HEAD.format(kind=kind) + "".join(blocks) + "</Layer></Optical></WindowElement>"


def random_tree(rng, rank, depth=3, albedo=0.4, holes=0.3):
    """Text of a random tree: some nodes end early, some leaves are dark, values span decades."""

    def node(level):
        if level == depth or (level and rng.random() < 0.6):
            dark = rng.random() < holes
            return "{%.6g}" % (0 if dark else rng.random() ** 4 * albedo)
        return "{" + "".join(node(level + 1) for _ in range(1 << rank)) + "}"

    return node(0)


def random_matrix(rng, basis, albedo=0.4):
    n = len(BASES[basis])
    values = rng.random((n, n)) ** 4 * albedo / np.pi
    values[rng.random((n, n)) < 0.3] = 0
    return " ".join(f"{v:.6g}" for v in values.ravel())


def write(folder, kind, missing=(), seed=1, **options):
    """File with random components."""
    rng = np.random.default_rng(seed)
    names = [n for n in NAMES if n not in missing]
    path = folder / f"{kind.replace('/', '_').replace(' ', '_')}{seed}{''.join(missing)}.xml"
    if kind.startswith("Tensor"):
        rank = int(kind[-1])
        depth = 3 if rank == 3 else 2
        data = {n: random_tree(rng, rank, depth, **options) for n in names}
        path.write_text(xml(kind, data))
    else:
        path.write_text(xml("Columns", {n: random_matrix(rng, kind) for n in names}, kind))
    return path


KINDS = ["TensorTree4", "TensorTree3", "LBNL/Klems Full", "LBNL/Klems Half", "LBNL/Klems Quarter"]


def load(path, **parameters):
    kind = "klems" if bsdf_file.read(path).kind == "Klems" else "tensor_tree"
    return mi.load_dict({"type": kind, "filename": str(path), **parameters})


def vector(theta, phi):
    t, p = np.radians(theta), np.radians(phi)
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)


def as_vector(d):
    d = np.broadcast_to(d, np.shape(d)).reshape(-1, 3)
    return mi.Vector3f(*(mi.Float(np.ascontiguousarray(d[:, i], np.float32)) for i in range(3)))


def interaction(wi, count=1):
    """Point on a flat pane whose local frame is the file's: x right, y up, z into the room."""
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.n = mi.Normal3f(0, -1, 0)
    si.sh_frame = mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 0, 1), mi.Vector3f(0, -1, 0))
    si.wi = as_vector(wi)
    return si


def draw(bsdf, wi, mode, count, seed=1):
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    return bsdf.sample(
        mi.BSDFContext(mode), interaction(wi, count), sampler.next_1d(), sampler.next_2d()
    )


def random_directions(count, seed=0):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=-1, keepdims=True)
