"""Meaning of a check's numbers to a designer, in words."""

from __future__ import annotations

from drcmitsuba_plugins.bsdf_file import BsdfFile

from drcmitsuba.bsdf.balance import Energy, one_way
from drcmitsuba.bsdf.check_report import SUN, Width
from drcmitsuba.bsdf.lobes import StraightThrough

NEARLY_LAMBERTIAN = 0.9
"""Least share of the transmitted light that is the same for all directions."""
SHARP = 2.0
"""Width [deg] above which a cell of a fine tree hardly blurs a peak."""
MUCH = 0.05
"""Least share of the sun's light at stake for a hint about the mounting."""

ONE_WAY = 0.05
"""Error of reciprocity that is noted; those of files traced by rays stay below 0.02 [–]."""

Advice = tuple[str, tuple[str, ...]]


def model(
    kind: str,
    widths: tuple[Width, ...],
    straight: StraightThrough | None,
    lambertian: dict[str, float],
    energy: tuple[Energy, ...],
) -> Advice:
    """Choose 'none', 'any', 'geometry', 'tensor_tree' or 'klems', with reasons."""
    if any(e.verdict == "refused" for e in energy):
        worst = max(e.largest for e in energy)
        why = f"none: the file sends out {100 * worst:.0f} % of the light; correct the data"
        return "none", (why,)
    if not widths or straight is None:
        return "any", ("any: next to nothing is transmitted, only reflection counts",)
    outside = energy[0].transmittance
    even = max(lambertian.get("tb", 0.0), lambertian.get("tf", 0.0)) / max(outside, 1e-9)
    own = "klems" if kind == "Klems" else "tensor_tree"
    if even >= NEARLY_LAMBERTIAN:
        why = f"any: {100 * min(even, 1):.0f} % of the transmitted light is Lambertian"
        return "any", (why,)
    # The peak that is narrowest against its cell decides.
    sharpest = min(widths, key=lambda w: w.half_maximum / w.resolution)
    resolved = all(w.is_resolved for w in widths)
    view = straight.stands_out and straight.share > 0.5 * max(w.share for w in widths)
    blurred = not resolved and sharpest.resolution > SHARP and not view
    return ("geometry" if blurred else own), (
        _geometry(sharpest, straight, blurred, view),
        _klems(kind, sharpest, view, resolved),
        _tensor_tree(kind, sharpest, view, blurred),
    )


def _geometry(w: Width, straight: StraightThrough, blurred: bool, view: bool) -> str:
    if blurred:
        return (
            f"geometry: for a sun {w.elevation:.0f}° high the peak is {w.half_maximum:.0f}° wide "
            f"and the file's cell {w.resolution:.0f}°, so the true peak may be as narrow as the "
            f"sun's {SUN}°: trace the film's shape for glare and ASE"
        )
    if view:
        share = f"{100 * straight.share:.0f} % of the transmitted light"
        return f"geometry: not called for, {share} goes straight through and is kept sharp"
    return f"geometry: not called for, the narrowest peak ({w.half_maximum:.0f}°) is resolved"


def _klems(kind: str, w: Width, view: bool, resolved: bool) -> str:
    wide, cell = w.half_maximum, w.resolution
    if kind != "Klems":
        coarse = "too coarse for" if wide < 20 else "enough for"
        return f"klems: patches of about 10° are {coarse} a peak of {wide:.0f}°"
    if view:
        return f"klems: what does not go straight through is spread over patches of {cell:.0f}°"
    verb = "hold" if resolved else "blur"
    return (
        f"klems: patches of {cell:.0f}° {verb} a peak of {wide:.0f}°; enough for yearly sums, not "
        "for glare or the edge of a sun patch"
    )


def _tensor_tree(kind: str, w: Width, view: bool, blurred: bool) -> str:
    if kind == "Klems":
        return "tensor_tree: better where one can be had, its cells adapt to the peaks"
    if view:
        return (
            f"tensor_tree: holds what does not go straight through (cells of {w.resolution:.1f}°)"
        )
    verb = "blurs" if blurred else "holds"
    return f"tensor_tree: {verb} the peaks with cells of {w.resolution:.1f}°"


def mounting(parts: dict[str, float]) -> str:
    """Hint at a film that may be mounted the wrong way; empty without evidence."""
    if not parts:
        return ""
    best = max(parts, key=lambda name: parts[name])
    own = parts.get("as the file says", 0.0)
    if parts[best] < own + MUCH or parts[best] < 1.5 * own:
        return ""
    return (
        f"hint: as the file says, {100 * own:.0f} % of the light of suns 25–60° high goes up into "
        f"the room; mounted {best if best != 'both' else 'both ways turned'}, it is "
        f"{100 * parts[best]:.0f} %: if this film redirects light, check how it was measured"
    )


COMPONENTS = {
    "tb": "transmission from outside",
    "tf": "transmission from the room",
    "rb": "reflection to the outside",
    "rf": "reflection into the room",
}
"""Components of a file in words."""


def dark(file: BsdfFile) -> tuple[str, ...]:
    """Components in words that the file lacks, and that do not follow by reciprocity."""
    return tuple(text for name, text in COMPONENTS.items() if file.component(name) is None)


def not_reciprocal(file: BsdfFile) -> str:
    """By how much light differs from light the other way, in words; empty within the noise."""
    words = {
        "transmission": "transmission", "rb": "reflection to the outside",
        "rf": "reflection into the room",
    }  # fmt: skip
    beyond = {words[k]: error for k, error in one_way(file).items() if error > ONE_WAY}
    return ", ".join(f"{100 * error:.0f} % of its {name}" for name, error in beyond.items())


def gaps(file: BsdfFile) -> tuple[str, ...]:
    """Sentences on missing components and on chromaticity in the file."""
    notes = []
    for name, text in COMPONENTS.items():
        if name in file.components:
            continue
        by_reciprocity = file.component(name) is not None
        notes.append(f"{text} is missing: taken {'by reciprocity' if by_reciprocity else 'as 0'}")
    if file.colour:
        notes.append(f"chromaticity is given for {', '.join(sorted(file.colour))}")
    return tuple(notes)
