"""The table `[design]` of a case: design space and objective of a search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Name, Percent, Side, Table, choose, shortened

Share = Annotated[float, Field(ge=0, le=1)]
Tilt = Annotated[float, Field(gt=-90, lt=90)]
Facing = Literal[
    "south", "east", "north", "west", "south-east", "north-east", "north-west", "south-west"
]  # fmt: skip

OF_TILT = ("tilt", "tilt_step")
"""Keys that only the search for a tilt has."""
OF_BOTH = ("objective", "ase_limit", "sharpness")
"""Keys that both searches have; all others belong to the search for a façade."""
OF_MODELS = ("panes", "groups", "spaces", "walls")
"""Keys by which a search means parts of a model."""
OF_WALLS = ("spaces", "walls", "clear", "band", "rows", "row_height", "segments", "wwr")
"""Keys by which the outer walls of a model are cut into tiles, which may become windows."""


class Design(Table):
    """Search for the best façade with a film, or for the best tilt of lamellae."""

    film: str | None = None
    """Material of the film that may replace the clear material; the shade does not cover it."""
    component: str | None = None
    """Structure of [components] whose lamellae are tilted; excludes `film`."""
    tilt: tuple[Tilt, Tilt] = (-30.0, 30.0)
    """Lowest and highest tilt of the lamellae [deg]."""
    tilt_step: Annotated[float, Field(gt=0, le=45)] = 1.0
    """Step of the search over tilts and of its finite differences [deg]."""
    clear: str | None = None
    """Clear material; default: the clear material of the façade as it is."""
    side: Facing | None = None
    """Side of the room, or direction that a model's panes or walls face; default: the one side
    with panes of a room, all directions of a model."""
    panes: Annotated[tuple[Name, ...], Field(max_length=1000)] = ()
    """Names of the materials of a model's panes that may take the film; `*` stands for any text. By
    default all clear panes, and none where walls get windows."""
    groups: Annotated[tuple[Name, ...], Field(max_length=1000)] = ()
    """Names of [groups] of a model whose panes may take the film; by default any, and panes of
    none."""
    spaces: Annotated[tuple[Name, ...], Field(max_length=10_000)] = ()
    """Names of a model's spaces whose outer walls may get windows; `*` stands for any text. By
    default all spaces."""
    walls: Annotated[tuple[Name, ...], Field(max_length=1000)] = ()
    """Names of the materials of a model's outer walls that may get windows; `*` stands for any
    text. By default all materials."""
    band: tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(gt=0)]] | None = None
    """Lowest and highest edge of panes above the floor [m]; default: the edges of the façade as it
    is, and of a model's wall all of it."""
    parameters: Literal["window", "strips"] = "window"
    """"window": one window with one film in it; "strips": every tile by itself."""
    rows: Annotated[int, Field(ge=1, le=100)] | None = None
    """Number of tiles one above the other, in each wall of a space of a model; default: six, or by
    `row_height`."""
    row_height: Annotated[float, Field(gt=0, le=100)] | None = None
    """Approximate height of a tile, in place of `rows` [m]."""
    segments: Annotated[int, Field(ge=1, le=200)] | None = None
    """Number of tiles side by side; default: the façade's segments, and one in a model's wall."""
    wwr: Literal["fixed"] | tuple[Share, Share] = "fixed"
    """Window-to-wall ratio: "fixed" as the façade has it, or a range [–]."""
    objective: Literal["sDA", "worst month", "standard", "glare", "area"] = "sDA"
    """Metric to maximise: sDA, msDA of the worst month, the margin by which a `level` of a
    `standard` is reached, or the hours without glare at the view of the case that has the fewest.
    "area": the least area that has `sda_least`, or reaches the level, of windows where `wwr` is a
    range, of film where the windows stay."""
    sda_least: Percent | None = None
    """Least sDA, for the objective "area" [%]."""
    standard: Name | None = None
    """Name of a standard as `comply` has it, for the objectives "standard" and "area"."""
    level: Name | None = None
    """Level of the standard, such as "2 points"; default: its lowest level."""
    film_cost: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Reduction of the objective where film fills the whole band [%]; less film costs less."""
    ase_limit: Percent = 10.0
    """Largest ASE [%]."""
    glare_limit: Percent | None = None
    """Largest share of the occupied hours with daylight in which DGP exceeds 0.40 at any view of
    the case, shade applied [%]; default: no limit."""
    starts: Annotated[int, Field(ge=1, le=1000)] = 1
    """Number of starts: half of each range, then random ones; the best of the case's own façade and
    of plain ones is one more. One or two free values are swept instead."""
    pareto: Annotated[int, Field(ge=0, le=100)] = 8
    """Number of limits of ASE on the Pareto front; 0 computes no front."""
    sharpness: Annotated[
        tuple[Annotated[float, Field(ge=1, le=1e6)], ...], Field(min_length=1, max_length=20)
    ] = (4.0, 8.0, 16.0, 32.0)
    """Sharpness of the smooth metrics in successive searches [–]; large values near the metrics."""
    iterations: Annotated[int, Field(ge=1, le=1000)] = 20
    """Largest number of steps at each sharpness."""
    seed: Annotated[int, Field(ge=0, le=1 << 30)] = 0
    """Seed of the random starts."""
    glazing_transmittance: tuple[Share, Share] | None = None
    """Range of the clear material's transmittance [–], in a model that of all panes that may take
    the film; default: the transmittance is fixed."""
    shade_vlt: tuple[Share, Share] | None = None
    """Range of the shade's transmittance [–]; default: the transmittance is fixed."""

    @property
    def cuts_walls(self) -> bool:
        """Whether walls of a model are to be cut into tiles."""
        return not self.model_fields_set.isdisjoint(OF_WALLS)

    @property
    def aim(self) -> Literal["sDA", "worst month", "standard", "glare"]:
        """Metric that is maximised, or that the least area has to reach."""
        if self.objective != "area":
            return self.objective
        return "sDA" if self.standard is None else "standard"

    @property
    def asks_glare(self) -> bool:
        """Whether hours of glare are an objective or have a limit."""
        return self.objective == "glare" or self.glare_limit is not None

    @model_validator(mode="after")
    def _one_kind(self) -> Design:
        if self.component is None:
            if self.film is None:
                got = "neither film nor component is named"
                raise InputError("design", "film", got, "name a material, or lamellae to be tilted")
            for key in OF_TILT:
                if key in self.model_fields_set:
                    got = "no component is named"
                    raise InputError("design", key, got, "name the lamellae: component = …")
            return self
        for key in sorted(self.model_fields_set - {"component", *OF_TILT, *OF_BOTH}):
            got = "the tilt of a component is searched, not a façade"
            raise InputError("design", key, got, "leave it out")
        low, high = self.tilt
        if high - low < 2 * self.tilt_step:
            got = f"{low:g} to {high:g}"
            remedy = f"give the lower value first, and at least {2 * self.tilt_step:g}° between"
            raise InputError("design", "tilt", got, remedy)
        return self

    @model_validator(mode="after")
    def _condition(self) -> Design:
        if self.objective in ("standard", "area", "glare") and self.component is not None:
            got = "the tilt of a component is searched by sDA or msDA alone"
            raise InputError("design", "objective", got, 'give "sDA" or "worst month"')
        if self.objective == "area" and self.sda_least is None and self.standard is None:
            got = "the objective is the least area, of which nothing is asked"
            remedy = "give the least sDA [%], sda_least = 55, or the name of a standard"
            raise InputError("design", "sda_least", got, remedy)
        if self.objective == "standard" and self.standard is None:
            got = "the objective is the margin of a standard, which is not named"
            raise InputError("design", "standard", got, 'name one, such as "leed-v4.1"')
        if self.sda_least is not None and self.standard is not None:
            got = "a standard is asked for, too"
            raise InputError("design", "sda_least", got, "give one of them")
        for key, serves in (("sda_least", ("area",)), ("standard", ("standard", "area"))):
            if getattr(self, key) is not None and self.objective not in serves:
                got = f"the objective is {self.objective}"
                raise InputError("design", key, got, 'leave it out, or give objective = "area"')
        if self.level is not None and self.standard is None:
            got = "no standard is named"
            raise InputError("design", "level", got, "name the standard, or leave it out")
        return self

    @model_validator(mode="after")
    def _ranges(self) -> Design:
        if self.rows is not None and self.row_height is not None:
            raise InputError("design", "row_height", "rows are given too", "give one of them")
        for key in ("band", "wwr", "glazing_transmittance", "shade_vlt"):
            limits = getattr(self, key)
            if isinstance(limits, tuple) and limits[1] < limits[0] + (1e-3 if key == "band" else 0):
                got = f"{limits[0]:g} to {limits[1]:g}"
                raise InputError("design", key, got, "give the lower value first")
        return self

    def check_facade(
        self, height: float, films: Sequence[str], clear: Sequence[str], glazed: Sequence[Side]
    ) -> None:
        """Refuse a search for a façade of unknown materials, or in a side without panes.

        The room has a `height` [m]; `films` and `clear` are the names of the materials that can be
        the film or the clear material, `glazed` the sides that have panes.
        """
        for key, name, known in (("film", self.film, films), ("clear", self.clear, clear)):
            if name is not None and name not in known:
                got = f"{shortened(name)} is no such material in [materials]"
                raise InputError("case", f"design.{key}", got, choose(name, known))
        for key in OF_MODELS:
            if getattr(self, key):
                got, remedy = f"{key} of a model, the case has a room of boxes", "name a side"
                raise InputError("case", f"design.{key}", got, remedy)
        if self.side is not None and self.side not in get_args(Side):
            got, remedy = f"{self.side} of a room of boxes", choose(self.side, get_args(Side))
            raise InputError("case", "design.side", got, remedy)
        if self.film == self.clear:
            raise InputError("case", "design.film", "it is the clear one", "name another material")
        if self.band is not None and self.band[1] > height:
            got = f"the room is {height:g} m high"
            raise InputError("case", "design.band", got, "lower its upper edge")
        if self.side is None and len(glazed) != 1:
            got = f"{len(glazed)} sides have panes"
            raise InputError("case", "design.side", got, 'name one, side = "south"')
        bare = self.side is not None and self.side not in glazed
        if bare and (self.band is None or self.wwr == "fixed"):
            got = f"the {self.side} side has no panes"
            raise InputError("case", "design.side", got, "give band and wwr = [low, high]")

    def check_tilt(self, structures: Sequence[str], standing: Sequence[str]) -> None:
        """Refuse to tilt a component that is not among the `structures`, or not `standing`."""
        name, where = str(self.component), "design.component"
        if name not in structures:
            got = f"{shortened(name)} is no structure in [components]"
            raise InputError("case", where, got, choose(name, structures))
        if name not in standing:
            got = f"{shortened(name)} stands nowhere"
            raise InputError("case", where, got, "name it as the material of a strip")
