"""Report of a check of a BSDF file: its values, and a table of them."""

from __future__ import annotations

import html
from dataclasses import asdict, dataclass
from typing import Any

from drcmitsuba.bsdf.balance import Energy
from drcmitsuba.bsdf.lobes import StraightThrough

SUN = 0.5
"""Diameter of the sun [deg]."""


@dataclass(frozen=True)
class Curve:
    """Transmittance and reflectance over incidence `theta` [deg], for one side and azimuth."""

    side: str
    plane: str
    theta: tuple[float, ...]
    transmittance: tuple[float, ...]
    reflectance: tuple[float, ...]


@dataclass(frozen=True)
class Sunlight:
    """Transmitted light of the sun in the plane normal to the façade."""

    elevation: float
    """Elevation of the sun [deg]."""
    transmittance: float
    upward: float
    """T, and the share of the transmitted light that goes up."""


@dataclass(frozen=True)
class Width:
    """Main peak of the transmitted light."""

    elevation: float
    """Elevation of the sun [deg]."""
    toward: float
    """Elevation of the peak [deg], up positive."""
    half_maximum: float
    half_light: float
    """Full openings [deg] of the cones with the solid angle of the directions above half of the
    largest f, and of the brightest directions that hold half of the light."""
    share: float
    """Share of the transmitted light in directions above half of the largest f."""
    resolution: float
    """Full opening [deg] of the cone with the solid angle of the file's cell at the peak."""

    @property
    def is_resolved(self) -> bool:
        """Whether the peak is more than 1.5 times as wide as its cell."""
        return self.half_maximum > 1.5 * self.resolution


@dataclass(frozen=True)
class CheckReport:
    """Result of `check`, which describes the fields."""

    source: str
    name: str
    manufacturer: str
    kind: str
    leaves: dict[str, int]
    curves: tuple[Curve, ...]
    energy: tuple[Energy, ...]
    reciprocity: dict[str, float | None]
    sunlight: tuple[Sunlight, ...]
    widths: tuple[Width, ...]
    straight: StraightThrough | None
    lambertian: dict[str, float]
    mounting: dict[str, float]
    hint: str
    model: str
    reasons: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """The worse verdict of both sides: 'ok', 'scaled' or 'refused'."""
        order = ("ok", "scaled", "refused")
        return max((e.verdict for e in self.energy), key=order.index)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**asdict(self), "verdict": self.verdict}

    def rows(self) -> list[tuple[str, str]]:
        """Rows of the report's table: subject and result."""
        name = ", ".join(filter(None, (self.name, self.manufacturer)))
        leaves = ", ".join(f"{n} {k} values" for n, k in self.leaves.items())
        table = [
            ("file", self.source),
            ("name", " ".join(name.split()) or "–"),
            ("kind", f"{self.kind}; {leaves}"),
            ("faces the room", "the file's Back (+z, Radiance's front)"),
        ]
        for e in self.energy:
            side = "the room" if e.side == "room" else e.side
            table.append((f"diffuse light from {side}", _energy(e)))
        for s in self.sunlight:
            text = f"T {100 * s.transmittance:.1f} %, of it {100 * s.upward:.0f} % upward"
            table.append((f"sun {s.elevation:.0f}° high", text))
        for w in self.widths:
            text = (
                f"toward {w.toward:+.0f}°, {w.half_maximum:.1f}° wide at half maximum "
                f"({100 * w.share:.0f} % of the light), half of the light within "
                f"{w.half_light:.0f}°; cell {w.resolution:.1f}°, sun {SUN}°"
            )
            table.append((f"peak, sun {w.elevation:.0f}° high", text))
        if self.straight is not None:
            view = self.straight
            text = (
                f"{100 * view.share:.1f} % of the transmitted light, {100 * view.normal:.1f} % of "
                "the light at normal incidence"
            )
            table.append(("view straight through", text if view.stands_out else f"none ({text})"))
        if self.lambertian:
            text = ", ".join(f"{n} {100 * v:.1f} %" for n, v in self.lambertian.items())
            table.append(("Lambertian part", text))
        for name, error in self.reciprocity.items():
            text = "one direction only" if error is None else f"{100 * error:.1f} % error"
            if not (error is None and name != "transmission"):
                table.append((f"reciprocity, {name}", text))
        table.append(("model", self.model.replace("_", " ")))
        table += [("", reason) for reason in self.reasons]
        if self.hint:
            table.append(("mounting", self.hint))
        return table + [("note", note) for note in self.notes]

    def __str__(self) -> str:
        rows = self.rows()
        width = max(len(label) for label, _ in rows)
        return "\n".join(f"{label:<{width}}  {text}" for label, text in rows)

    def _repr_html_(self) -> str:
        cells = (
            "<tr><th>{}</th><td>{}</td></tr>".format(*map(html.escape, r)) for r in self.rows()
        )
        return f"<table>{''.join(cells)}</table>"


def _energy(e: Energy) -> str:
    verdicts = {
        "ok": "ok",
        "scaled": "at most 5 % too much, will be scaled down",
        "refused": "refused: more than 5 % too much",
    }
    return (
        f"T {100 * e.transmittance:.1f} %, R {100 * e.reflectance:.1f} %; largest T + R "
        f"{100 * e.largest:.1f} % at θ {e.theta:.0f}°, φ {e.phi:.0f}° ({verdicts[e.verdict]})"
    )
