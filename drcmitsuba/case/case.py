"""The case file: all tables together, checked before anything runs.

A case is a TOML file. Each of its tables has a module of its own, which also checks the table
against the others. An unknown key is an error, and so is a value out of its range.
Lengths are metres, angles degrees. The room's frame has its origin in the south-west corner of the
floor, x to the east, y to the north, z up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.colour import Colour
from drcmitsuba.case.components import (
    Component,
    StructureComponent,
    check_components,
)
from drcmitsuba.case.design import Design
from drcmitsuba.case.effects import Effects
from drcmitsuba.case.facade import Facade, check_names
from drcmitsuba.case.furniture import Furniture, check_furniture
from drcmitsuba.case.groups import OTHERS, Group
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.case.model import ModelTable
from drcmitsuba.case.output import Output
from drcmitsuba.case.room import Room
from drcmitsuba.case.sensors import (
    AnySensors,
    FloorSensors,
    PointSensors,
    Sensors,
    SpaceSensors,
)
from drcmitsuba.case.shading import AREA, THRESHOLD, Shading
from drcmitsuba.case.sky import Outside, PerezSky, Sky
from drcmitsuba.case.spaces import SpaceTable, check_box, check_spaces
from drcmitsuba.case.sun import Adaptive, Sun, TrueSun, check_sun
from drcmitsuba.case.unit_check import ask_about_furniture, ask_about_room, ask_about_spacing
from drcmitsuba.case.uses import UseTable
from drcmitsuba.case.views import ViewTable
from drcmitsuba.case.weather import PeriodTable, SiteTable, WeatherFile
from drcmitsuba.model.materials import (
    DielectricMaterial,
    GlazingMaterial,
    Material,
    MirrorMaterial,
    PorousMaterial,
)
from drcmitsuba.model.model import EMPTY, Model
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import (
    Name,
    Side,
    Table,
    choose,
    named_of_kind,
    shortened,
)


class Case(Table):
    """Case file: room, façade, sky, sensors and accuracy of one evaluation.

    Examples
    --------
    >>> import drcmitsuba
    >>> case = drcmitsuba.load_case("classroom/existing")
    >>> case.metrics.sda_threshold
    500.0
    >>> other = case.with_tables(metrics=case.metrics.model_copy(update={"sda_threshold": 300.0}))
    >>> other.metrics.sda_threshold
    300.0
    """

    name: Name = "case"
    """Title of tables and pictures."""
    unit: Literal["m"] | None = None
    """Unit of all lengths; "m" accepts lengths that look like millimetres as metres."""
    site: SiteTable | None = None
    """Place, where there is no weather file."""
    weather: WeatherFile = WeatherFile()
    """Weather file."""
    period: PeriodTable = PeriodTable()
    """Hours that are evaluated."""
    sky: Sky = PerezSky()
    """Model of the sky."""
    sun: Sun = TrueSun()
    """Model of the sun."""
    outside: Outside = Outside()
    """Ground, and the size of the sun."""
    room: Room | None = None
    """Box of the room; without it and a model, the sensors are under the free sky."""
    model: ModelTable | None = None
    """Building that was drawn elsewhere."""
    facade: dict[Side, Facade] = Field(default_factory=dict)
    """Sides of the room that have panes, by name."""
    materials: dict[str, Material] = Field(default_factory=dict)
    """Materials by name."""
    components: Annotated[dict[str, Component], Field(max_length=100)] = Field(default_factory=dict)
    """Components that are geometry, by name."""
    furniture: Annotated[tuple[Furniture, ...], Field(max_length=10_000)] = ()
    """Boxes and plates, inside the room or outside of it."""
    spaces: Annotated[dict[Name, SpaceTable], Field(max_length=10_000)] = Field(
        default_factory=dict
    )
    """Rooms of the model by name, beside those that its files tell."""
    uses: Annotated[dict[Name, UseTable], Field(max_length=1000)] = Field(default_factory=dict)
    """Uses of rooms by name, before those of the program, whose keys they overrule."""
    sensors: AnySensors
    """Points at which the illuminance is computed."""
    shading: Shading | None = None
    """Sun shade of the clear panes; without it, there is none."""
    groups: Annotated[dict[Name, Group], Field(max_length=100)] = Field(default_factory=dict)
    """Panes that change their state together, by name."""
    colour: Colour = Colour()
    """Bands of the light, and spectra of sources and surfaces."""
    views: Annotated[dict[Name, ViewTable], Field(max_length=1000)] = Field(default_factory=dict)
    """Views by name, beside those of the model."""
    metrics: Metrics = Metrics()
    """Thresholds of the metrics."""
    accuracy: Accuracy = Accuracy()
    """Numbers of samples, and the intervals to reach."""
    effects: Effects = Effects()
    """Effects of light that are simulated."""
    output: Output = Output()
    """Spaces that are evaluated, and arrays that are kept."""
    design: Design | None = None
    """Design space and objective of `optimise`."""

    _source: str = PrivateAttr("case")
    _folder: Path = PrivateAttr(Path())
    _building: Model = PrivateAttr(EMPTY)

    @property
    def source(self) -> str:
        """Name of the case's file, for messages."""
        return self._source

    @property
    def building(self) -> Model:
        """Surfaces, sensors and views of the files of `[model]`; empty without any."""
        return self._building

    @property
    def glazed(self) -> tuple[Side, ...]:
        """Sides with panes or holes."""
        facades = self.facade.items()
        return tuple(side for side, f in facades if any(s.material != "wall" for s in f.strips))

    @property
    def standing(self) -> tuple[str, ...]:
        """Names of the placed components: a structure is placed by a strip that names it.

        Mirrors and clear solids of a model are components, too.
        """
        strips = {s.material for f in self.facade.values() for s in f.strips}
        placed = (
            name
            for name, component in self.components.items()
            if name in strips or not isinstance(component, StructureComponent)
        )
        return (*placed, *(layer.name for layer in self.building.layers if layer.deviates))

    @property
    def shade_rule(self) -> tuple[float, float]:
        """Threshold [lx] and area [–] of the rule that closes shades; LM-83's without [shading]."""
        return (THRESHOLD, AREA) if self.shading is None else (
            self.shading.threshold, self.shading.area
        )  # fmt: skip

    def refuse_overruled(self, task: str) -> None:
        """Raise InputError where an effect is not "auto": the task ignores such choices."""
        for name in self.effects.overruled:
            got = f"{task} simulates what it needs"
            raise InputError(self.source, f"effects.{name}", got, 'leave it "auto"')

    def is_clear(self, name: str) -> bool:
        """Whether a strip's material is a hole or clear glass; the shade covers these only."""
        return name == "open" or isinstance(self.materials.get(name), GlazingMaterial)

    @property
    def panes(self) -> tuple[str, ...]:
        """Names of the materials that a pane can have."""
        solid = (MirrorMaterial, DielectricMaterial, PorousMaterial)
        return tuple(k for k, m in self.materials.items() if not isinstance(m, solid))

    @model_validator(mode="after")
    def _tables_agree(self) -> Case:
        check_names(self.materials)
        check_furniture(self.furniture)
        check_components(self.components, self.materials, self.room is not None)
        check_sun(self.sun, self.effects, bool(self.standing))
        if self.unit is None:
            if self.room is None and isinstance(self.sensors, Sensors):
                ask_about_spacing(self.sensors.spacing)
            elif self.room is not None:
                ask_about_room(self.room.size)
                for i, piece in enumerate(self.furniture):
                    ask_about_furniture(f"furniture.{i}", piece.corner, piece.size, self.room.size)
        for side, facade in self.facade.items():
            self._check_facade(side, facade)
        if self.shading is not None:
            self.shading.check(self.materials)
        for name, group in self.groups.items():
            self._check_group(name, group)
        for name, view in self.views.items():
            view.check(name)
        if self.design is not None:
            self._check_design(self.design)
        if self.room is not None and self.model is not None:
            got = "beside a room of boxes"
            raise InputError("case", "model", got, "give one of them")
        for name, group in self.groups.items():
            if self.model is not None and name in self.model.states and not group.panes:
                got, remedy = "model.states keeps it in one state", "give one of them"
                raise InputError("case", f"groups.{name}", got, remedy)
        if self.model is None:
            check_box(self.spaces, self.name)
        check_spaces(self.spaces, self.uses, self.groups, self.period)
        if self.model is None and not isinstance(self.sensors, Sensors):
            for kind, key in ((FloorSensors, "floors"), (SpaceSensors, "spaces")):
                if isinstance(self.sensors, kind):
                    raise InputError("case", f"sensors.{key}", "there is no [model]", "add one")
            assert isinstance(self.sensors, PointSensors)
            if self.sensors.grids:
                raise InputError("case", "sensors.grids", "there is no [model]", "add one")
        return self

    def _check_group(self, name: str, group: Group) -> None:
        """Refuse a reserved name, and states that are no material of a pane."""
        if name == OTHERS:
            got = "the name of the panes without a group"
            raise InputError("case", f"groups.{name}", got, "give another name")
        for state in group.states:
            if state not in self.panes:
                got = f"{shortened(state)} is no material of a pane in [materials]"
                remedy = choose(state, list(self.panes))
                raise InputError("case", f"groups.{name}.states", got, remedy)

    def _needed_room(self, table: str) -> Room:
        """Room of the case; refuses a table that needs a room where there is none."""
        if self.room is None:
            raise InputError("case", table, "there is no room", "add a [room]")
        return self.room

    def _check_facade(self, side: Side, facade: Facade) -> None:
        """Refuse strips that do not fit into their wall, or of an unknown material."""
        structures = named_of_kind(self.components, (StructureComponent,))
        known = ["wall", "open", *self.panes, *structures]
        names = [*self.materials, *self.components]
        facade.check(side, self._needed_room("facade").wall(side), known, names)

    def _check_design(self, design: Design) -> None:
        """Refuse a search that contradicts the other tables of the case."""
        if self.model is not None:  # its panes are known when its files are read
            return
        room = self._needed_room("design")
        if design.component is not None:
            design.check_tilt(named_of_kind(self.components, (StructureComponent,)), self.standing)
            return
        clear = named_of_kind(self.materials, (GlazingMaterial,))
        films = [name for name in self.panes if name not in clear]
        design.check_facade(room.size[2], films, clear, self.glazed)

    def path(self, file: Path) -> Path:
        """Resolve a file that the case names: relative ones lie beside the case file."""
        return file if file.is_absolute() else self._folder / file

    def with_tables(self, **tables: object) -> Case:
        """Replace tables by name, unchecked: values are those of the tables' classes, or None.

        A case with the same tables is itself: what was found out about it stays known.
        """
        same = all(_are_same(getattr(self, name), value) for name, value in tables.items())
        return self if same else self._copied(tables)

    def _copied(self, tables: Mapping[str, object]) -> Case:
        changed = self.model_copy(update=tables)
        changed._source, changed._folder = self._source, self._folder
        changed._building = self._building
        return changed

    @property
    def extent(self) -> tuple[float, ...] | None:
        """Extent of the rooms along the axes of their file (3,) [m]; None without any."""
        if self.room is not None:
            return self.room.size
        near = [x.quads.reshape(-1, 3) for x in self.building.layers if x.role != "context"]
        return tuple(np.ptp(np.concatenate(near), axis=0).tolist()) if near else None

    def with_true_suns(self) -> Case:
        """Have true suns in place of an adaptive sun, whose mesh follows one façade."""
        return self.with_tables(sun=TrueSun()) if isinstance(self.sun, Adaptive) else self

    def without_polish(self) -> Case:
        """Have faintly mirroring surfaces of the model diffuse, for tasks that count no mirrors."""
        return self.with_building(self.building.without_polish())

    def with_building(self, building: Model) -> Case:
        """Put another building in place of that of the model's files."""
        changed = self._copied({})
        changed._building = building
        return changed

    def with_facade(self, side: Side, facade: Facade) -> Case:
        """Replace one façade; InputError where it does not fit into the room."""
        self._check_facade(side, facade)
        return self.with_tables(facade={**self.facade, side: facade})

    def with_dark_hours(self) -> Case:
        """Simulate the suns of all time stamps, for coefficients that serve any weather."""
        return self.with_tables(effects=self.effects.model_copy(update={"dark_hours": "all"}))

    def with_spaces(self, patterns: Sequence[str]) -> Case:
        """Evaluate the sensors of some spaces, by their names; without any, those of all."""
        if not patterns:
            return self
        return self.with_tables(output=self.output.model_copy(update={"spaces": tuple(patterns)}))

    def with_weather(self, file: Path | None) -> Case:
        """Replace the weather file; None keeps the case's own."""
        if file is None:
            return self
        return self.with_tables(weather=WeatherFile(file=Path(file).absolute()))


def _are_same(own: object, other: object) -> bool:
    """Whether two tables have the same values, and the same ones of them were stated."""
    first, second = (getattr(table, "model_fields_set", None) for table in (own, other))
    return own == other and first == second
