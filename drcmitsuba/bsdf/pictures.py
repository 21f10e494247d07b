"""Pictures of a BSDF file: the directions of a sun's light, and T and R over incidence.

Figures are made without pyplot, so no global state changes and no window opens.
"""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile, Component
from drcmitsuba_plugins.tensor import to_disk
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Wedge

from drcmitsuba.bsdf.check_report import CheckReport
from drcmitsuba.bsdf.lobes import Lobe, cells_at, lobe, sun

BLUE, ORANGE, GREEN, PURPLE, GREY, INK = (
    "#0072B2", "#D55E00", "#009E73", "#AA4499", "#5A5A5A", "#222222",
)  # fmt: skip
CELLS = 128
"""Number of cells of a map along either axis, as in a tree of depth 7."""
DECADES = 4
"""Range of the colour scale below the largest f [decades]."""
STEP = 5
"""Width of the wedges of a section [deg]."""


def figures(
    file: BsdfFile, report: CheckReport, sun: tuple[float, float] = (45.0, 0.0)
) -> dict[str, Figure]:
    """Draw a BSDF file and its `check`, for the sun at an elevation and an azimuth [deg].

    The azimuth is from the façade's normal, clockwise from above.

    Returns
    -------
    dict of str to Figure
        'lobes.png': f of transmission and reflection over all directions; 'section.png': the share
        of the light in steps of 5° of profile angle; 'curves.png': T and R over incidence.
    """
    stem = report.source.replace("\\", "/").rpartition("/")[2]
    title = f"{report.name} ({stem})" if report.name else stem
    return {
        "lobes.png": lobes(file, title, *sun),
        "section.png": section(file, title, *sun),
        "curves.png": curves(report, title),
    }


def _heading(figure: Figure, title: str, subtitle: str) -> None:
    height = figure.get_figheight()
    shown = textwrap.shorten(" ".join(title.split()), 70, placeholder=" …")
    style: dict[str, Any] = {"fontsize": 12, "weight": "bold", "color": INK, "va": "top"}
    figure.text(0.03, 1 - 0.12 / height, shown, parse_math=False, **style)  # a name is no formula
    figure.text(0.03, 1 - 0.38 / height, subtitle, fontsize=9.5, va="top", color=GREY)


def _sun_text(elevation: float, azimuth: float) -> str:
    side = f", {abs(azimuth):.0f}° to the {'right' if azimuth > 0 else 'left'}" if azimuth else ""
    return f"sun outside, {elevation:.0f}° high{side}"


def _components(file: BsdfFile) -> dict[int, Component]:
    """Components of light from outside, by the side to which it leaves: room 1, outside −1."""
    both = {1: file.component("tb"), -1: file.component("rb")}
    return {side: component for side, component in both.items() if component is not None}


def lobes(file: BsdfFile, title: str, elevation: float, azimuth: float) -> Figure:
    """Maps of f [1/sr] over outgoing directions of the sun's light, to the room and outside."""
    incident = sun(elevation, azimuth)
    components = _components(file)
    figure = Figure(figsize=(9.6, 5.35))
    subtitle = _sun_text(elevation, azimuth)
    count = max((len(cells_at(c, incident)) for c in components.values()), default=1)
    if count > 1:
        subtitle += f": on the border of {count} cells of the file, of which the mean is shown"
    _heading(figure, title, subtitle)
    light_to = {side: lobe(c, incident, float(side), CELLS) for side, c in components.items()}
    largest = max((float(v.value.max()) for v in light_to.values()), default=0.0) or 1.0
    least = min(
        (float(v.value[v.value > 0].min(initial=largest)) for v in light_to.values()), default=0
    )
    norm = LogNorm(min(max(least, largest / 10**DECADES), largest / 10), largest)
    mesh: Any = None
    for at, (side, text, label) in enumerate((
        (1, "transmitted into the room", "undeviated"),
        (-1, "reflected to the outside", "as a mirror"),
    )):  # fmt: skip
        ax = figure.add_axes((0.02 + 0.435 * at, 0.01, 0.42, 0.42 * 9.6 / 5.35))
        _disk(ax)
        if side not in light_to:
            ax.text(0, 0, "not in the file", ha="center", va="center", color=GREY)
            ax.set_title(text, fontsize=10.5, color=INK, pad=4)
            continue
        light = light_to[side]
        mesh = _map(ax, light, norm)
        through = -incident[:2]
        box = {"boxstyle": "round,pad=0.2", "fc": INK, "ec": "none", "alpha": 0.75}
        ax.plot(*through, "o", ms=16, mfc="none", mec="white", mew=2.6, clip_on=False)
        ax.plot(*through, "o", ms=16, mfc="none", mec=INK, mew=1.2, clip_on=False)
        ax.annotate(
            label, through, (0, -19), textcoords="offset points", ha="center", fontsize=8.5,
            color="white", bbox=box,
        )  # fmt: skip
        up, total = light.upward(), 100 * light.power.sum()
        shares = f"{total * up:.1f} % up, {total * (1 - up):.1f} % down"
        ax.set_title(
            f"{text}: {total:.1f} % of the light\n{shares}", fontsize=10.5, color=INK, pad=4
        )
    if mesh is not None:
        bar = figure.add_axes((0.915, 0.08, 0.018, 0.56))
        figure.colorbar(mesh, cax=bar, extend="min")
        bar.set_title("f [1/sr]", fontsize=9.5, pad=8)
    return figure


def _disk(ax: Axes) -> None:
    """Draw an empty hemisphere as seen from the room: rings at 30° and 60° from the normal."""
    ax.set(xlim=(-1.14, 1.14), ylim=(-1.14, 1.14), aspect="equal")
    ax.axis("off")
    turn = np.linspace(0, 2 * np.pi, 181)
    for theta in (30, 60, 90):
        r = np.sin(np.radians(theta))
        style = {"color": INK, "linewidth": 1.1} if theta == 90 else {"color": "white"}
        ax.plot(r * np.cos(turn), r * np.sin(turn), **{"linewidth": 0.7, **style}, zorder=3)
        if theta < 90:
            at = r * np.cos(np.radians(20)), r * np.sin(np.radians(20))
            ax.text(*at, f"{theta}°", fontsize=8, color="white", zorder=4, ha="center", va="center",
                    bbox={"boxstyle": "round,pad=0.12", "fc": INK, "ec": "none", "alpha": 0.45},
                    )  # fmt: skip
    ax.plot([-1, 1], [0, 0], color="white", linewidth=1.1, linestyle=(0, (4, 3)), zorder=3)
    for text, x, y, turned in (
        ("up", 0, 1.07, 0), ("down", 0, -1.07, 0), ("left", -1.07, 0, 90), ("right", 1.07, 0, 270)
    ):  # fmt: skip
        ax.text(x, y, text, ha="center", va="center", fontsize=9, color=GREY, rotation=turned)


def _map(ax: Axes, light: Lobe, norm: LogNorm) -> Any:
    """Draw the values of the square's cells in the projected hemisphere."""
    edge = np.linspace(0, 1, CELLS + 1)
    x, y = to_disk(*np.meshgrid(edge, edge, indexing="ij"))
    shown = np.maximum(light.value.reshape(CELLS, CELLS), norm.vmin)
    return ax.pcolormesh(x, y, shown, cmap="inferno", norm=norm, rasterized=True)


def _profile(light: Lobe) -> np.ndarray:
    """Share [%] of the incident light in steps of profile angle, −90 to 90°, up positive."""
    edges = np.arange(-90, 91, STEP)
    angle = np.degrees(np.arctan2(light.outgoing[:, 1], np.abs(light.outgoing[:, 2])))
    return 100 * np.histogram(angle, edges, weights=light.power)[0]


def section(file: BsdfFile, title: str, elevation: float, azimuth: float) -> Figure:
    """Vertical section: shares of the sun's light by profile angle."""
    incident = sun(elevation, azimuth)
    figure = Figure(figsize=(8.4, 6.6))
    how = f"area of a wedge: share of the light within {STEP}° of profile angle; in % where above 3"
    _heading(figure, title, f"{_sun_text(elevation, azimuth)}\n{how}")
    ax = figure.add_axes((0.02, 0.01, 0.96, 0.87))
    ax.set(xlim=(-1.5, 1.5), ylim=(-1.4, 1.16), aspect="equal")
    ax.axis("off")
    light_to = {side: lobe(c, incident, float(side)) for side, c in _components(file).items()}
    shares = {side: _profile(light) for side, light in light_to.items()}
    largest = max((float(v.max()) for v in shares.values()), default=0.0) or 1.0
    _angles(ax)
    for side, colour, place, word in (
        (-1, ORANGE, "outside", "reflected"),
        (1, BLUE, "room", "transmitted"),
    ):
        text = f"{word}: not in the file"
        if side in light_to:
            _wedges(ax, side, shares[side], largest, colour)
            total, up = 100 * light_to[side].power.sum(), light_to[side].upward()
            text = f"{word} {total:.1f} %: {total * up:.1f} % up, {total * (1 - up):.1f} % down"
        style: dict[str, Any] = {"ha": "right" if side > 0 else "left", "va": "bottom"}
        ax.text(1.45 * side, -1.31, place, fontsize=10.5, color=INK, weight="bold", **style)
        ax.text(1.45 * side, -1.4, text, fontsize=10, color=colour, **style)
    ax.plot([0, 0], [-1.12, 1.12], color=INK, linewidth=4, solid_capstyle="butt", zorder=4)
    _sun_ray(ax, float(np.arctan2(incident[1], -incident[2])))
    return figure


def _wedges(ax: Axes, side: int, shares: np.ndarray, largest: float, colour: str) -> None:
    """Draw a wedge for each step of profile angle, from −90° up."""
    for i, share in enumerate(shares):
        r = np.sqrt(share / largest)  # so that the area shows the share
        low = -90 + STEP * i if side > 0 else 270 - STEP * (i + 1)
        style: dict[str, Any] = {"facecolor": colour, "alpha": 0.85, "ec": "white", "lw": 0.3}
        ax.add_patch(Wedge((0, 0), r, low, low + STEP, **style))
        if share > 3:
            middle = np.radians(low + STEP / 2)
            at = (r + 0.06) * np.cos(middle), (r + 0.06) * np.sin(middle)
            style = {"ha": "center", "va": "center", "weight": "bold", "fontsize": 8.5}
            ax.text(*at, f"{share:.0f}", color=colour, zorder=7, **style)


def _angles(ax: Axes) -> None:
    """Draw rays at 30° and 60°, and the horizon."""
    for angle in (-60, -30, 0, 30, 60):
        for side in (-1, 1):
            x, y = side * np.cos(np.radians(angle)), np.sin(np.radians(angle))
            dashed: dict[str, Any] = {"color": GREY, "linestyle": (0, (4, 3))}
            style = {"color": "#DDDDDD"} if angle else dashed
            ax.plot([0, 1.06 * x], [0, 1.06 * y], linewidth=0.8, zorder=0, **style)
            if side > 0:  # on the outside the sun's ray would cross the labels
                text = f"{angle:+d}°".replace("+0", "0")
                place: dict[str, Any] = {"ha": "center", "va": "center"}
                ax.text(1.13 * x, 1.13 * y, text, fontsize=8, color=GREY, **place)


def _sun_ray(ax: Axes, profile: float) -> None:
    """Draw the sun's ray, and its undeviated continuation (dashed)."""
    c, s = np.cos(profile), np.sin(profile)
    style: dict[str, Any] = {"color": "#E6A100", "zorder": 6}
    arrow = {"arrowstyle": "-|>", "color": "#E6A100", "linewidth": 2.6, "mutation_scale": 20}
    reach = min(1.25, 1.08 / max(abs(s), 1e-9))
    ax.annotate("", (-0.03 * c, 0.03 * s), (-reach * c, reach * s), arrowprops=arrow, zorder=6)
    ax.plot([0, 0.95 * c], [0, -0.95 * s], linewidth=1.2, linestyle=(0, (2, 2)), **style)
    style = {"color": "#9A6B00", "ha": "right", "va": "center", "weight": "bold"}
    ax.text(-reach * c - 0.03, reach * s, "sun", fontsize=10, **style)


def curves(report: CheckReport, title: str) -> Figure:
    """T and R over incidence, for light from outside and from the room."""
    figure = Figure(figsize=(9.6, 4.5))
    _heading(figure, title, "directional-hemispherical transmittance T and reflectance R")
    axes = figure.subplots(1, 2, sharey=True)
    figure.subplots_adjust(left=0.07, right=0.985, bottom=0.17, top=0.76, wspace=0.08)
    note = "The file holds one value for each cell of incidences: T and R are constant within a "
    note += "cell (plateaus); the widest cells lie near 90°."
    if report.kind == "Klems":
        note = (
            "The file holds one value for each ring of incidences: points are the rings' centres."
        )
    figure.text(0.07, 0.02, note, fontsize=8.5, color=GREY, va="bottom")
    colours = {"above": BLUE, "below": ORANGE, "right": GREEN, "left": PURPLE, "any": BLUE}
    styles: dict[str, Any] = {"left": {"linestyle": (0, (3, 2))}}
    top = max((max(c.transmittance + c.reflectance) for c in report.curves), default=1.0)
    for ax, side in zip(axes, ("outside", "room"), strict=True):
        ax.set_title(
            f"light from {'the ' * (side == 'room')}{side}", loc="left", fontsize=10.5, color=INK
        )
        for curve in (c for c in report.curves if c.side == side):
            style = {"color": colours[curve.plane], "linewidth": 1.8, **styles.get(curve.plane, {})}
            ax.plot(curve.theta, 100 * np.array(curve.transmittance), **style)
            ax.plot(curve.theta, 100 * np.array(curve.reflectance), **style, alpha=0.45)
        ax.set(xlim=(0, 90), ylim=(0, 100 * max(1.0, top)), xlabel="angle from the normal [°]")
        ax.set_xticks(range(0, 91, 15))
        ax.grid(color="#E4E4E4", linewidth=0.7)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("share of the light [%]")
    planes = list(dict.fromkeys(c.plane for c in report.curves))
    words = {"any": "from any side", "above": "from above", "below": "from below"}
    keys = [axes[1].plot([], [], color=colours[p], label=words.get(p, f"from the {p}"),
                         linewidth=1.8, **styles.get(p, {}))[0] for p in planes]  # fmt: skip
    keys += [
        axes[1].plot([], [], color=INK, alpha=a, label=k, linewidth=1.8)[0]
        for k, a in (("T", 1), ("R", 0.45))
    ]
    place = {"loc": "upper right", "bbox_to_anchor": (0.99, 0.9)}
    figure.legend(handles=keys, ncols=6, frameon=False, fontsize=9, **place)
    return figure
