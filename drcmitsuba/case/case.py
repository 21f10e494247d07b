"""The case file: what is simulated, checked before anything runs.

A case is a TOML file. Its tables are the classes below; a key that none of them knows is an error,
and so is a value out of its range. Lengths are metres, angles degrees. The room's frame has its
origin in the south-west corner of the floor, x to the east, y to the north, z up.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PrivateAttr, model_validator

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.components import (
    Component,
    MeshComponent,
    StructureComponent,
    check_components,
)
from drcmitsuba.case.design import Design
from drcmitsuba.case.effects import Effects
from drcmitsuba.case.facade import Facade
from drcmitsuba.case.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Material,
    MirrorMaterial,
    Reflectance,
)
from drcmitsuba.case.shipped import shipped_cases, shipped_folder
from drcmitsuba.case.sky import (
    Adaptive,
    Outside,
    PerezSky,
    PeriodTable,
    Site,
    Sky,
    Sun,
    ThreePhase,
    TrueSun,
    WeatherFile,
)
from drcmitsuba.case.toml import (
    Coordinate,
    Fraction,
    Length,
    Name,
    Point,
    Side,
    Table,
    checked,
    choose,
    read_toml,
    shortened,
)
from drcmitsuba.case.unit_check import ask_about_furniture, ask_about_room, ask_about_spacing
from drcmitsuba.runtime.errors import InputError

MAX_BYTES = 1 << 20

MOST_PIECES, MOST_SENSORS = 100_000, 250_000

Threshold = Annotated[float, Field(gt=0, le=1e9)]
"""Of illuminance [lx]; the largest is far beyond any sun."""


class Room(Table):
    """Box of a room. `rotation` turns it clockwise, seen from above, about the origin."""

    size: tuple[Length, Length, Length]
    rotation: Annotated[float, Field(ge=-360, le=360)] = 0.0
    floor: Reflectance = 0.2
    ceiling: Reflectance = 0.8
    walls: Reflectance = 0.5

    def wall(self, side: Side) -> tuple[float, float]:
        """Length and height of a wall [m]."""
        width, depth, height = self.size
        return (width if side in ("south", "north") else depth), height


class Furniture(Table):
    """Box, or horizontal plate where the height is 0, repeated on a grid."""

    name: Name = "furniture"
    corner: Point
    size: tuple[Length, Length, Annotated[float, Field(ge=0, le=100_000)]]
    reflectance: Reflectance = 0.5
    count: tuple[Annotated[int, Field(ge=1, le=1000)], Annotated[int, Field(ge=1, le=1000)]] = (
        1,
        1,
    )
    step: tuple[Coordinate, Coordinate] = (0.0, 0.0)


class Sensors(Table):
    """Grid of points that look up: the first at corner + spacing/2, x running fastest."""

    corner: Point
    count: tuple[Annotated[int, Field(ge=1, le=2000)], Annotated[int, Field(ge=1, le=2000)]]
    spacing: Length = 0.3


class Shading(Table):
    """Sun shade before the clear panes; closed when ≥ `area` of the points get ≥ `threshold`."""

    material: str
    threshold: Threshold = 1000.0
    area: Fraction = 0.02


class Metrics(Table):
    """Thresholds of sDA and ASE."""

    sda_threshold: Threshold = 300.0
    sda_fraction: Fraction = 0.5
    ase_threshold: Threshold = 1000.0
    ase_hours: Annotated[float, Field(gt=0, le=1e6)] = 250.0


class Case(Table):
    """Everything that one evaluation needs. See the tables' own classes for their keys."""

    name: Name = "case"
    unit: Literal["m"] | None = None
    """Of all lengths; "m" insists on lengths that look like millimetres."""
    site: Site | None = None
    weather: WeatherFile = WeatherFile()
    period: PeriodTable = PeriodTable()
    sky: Sky = PerezSky()
    sun: Sun = TrueSun()
    outside: Outside = Outside()
    room: Room | None = None
    facade: dict[Side, Facade] = Field(default_factory=dict)
    materials: dict[str, Material] = Field(default_factory=dict)
    components: Annotated[dict[str, Component], Field(max_length=100)] = Field(default_factory=dict)
    furniture: Annotated[tuple[Furniture, ...], Field(max_length=10_000)] = ()
    sensors: Sensors
    shading: Shading | None = None
    metrics: Metrics = Metrics()
    accuracy: Accuracy = Accuracy()
    effects: Effects = Effects()
    design: Design | None = None

    _source: str = PrivateAttr("case")
    _folder: Path = PrivateAttr(Path())

    @property
    def source(self) -> str:
        """The file that the case came from, for messages."""
        return self._source

    @property
    def glazed(self) -> tuple[Side, ...]:
        """Sides with panes or holes."""
        facades = self.facade.items()
        return tuple(side for side, f in facades if any(s.material != "wall" for s in f.strips))

    @property
    def standing(self) -> tuple[str, ...]:
        """Components that stand somewhere: structures only where a strip names them."""
        strips = {s.material for f in self.facade.values() for s in f.strips}
        return tuple(
            name
            for name, component in self.components.items()
            if name in strips or not isinstance(component, StructureComponent)
        )

    def refuse_overruled(self, task: str) -> None:
        """Raise InputError where an effect is overruled: the task follows no such choice."""
        for name in self.effects.overruled:
            got = f"{task} simulates what it needs"
            raise InputError(self.source, f"effects.{name}", got, 'leave it "auto"')

    def refuse_components(self, task: str) -> None:
        """Raise InputError where a component stands, or an effect is overruled.

        The task counts no light by way of components, and follows no such choice.
        """
        self.refuse_overruled(task)
        if self.standing:
            got = f"{task} counts no light by way of {shortened(self.standing[0])}"
            raise InputError(self.source, "components", got, "leave them out, or use evaluate")

    def is_clear(self, name: str) -> bool:
        """Whether a strip's material is a hole or clear glass, which the shade covers."""
        return name == "open" or isinstance(self.materials.get(name), GlazingMaterial)

    @property
    def panes(self) -> tuple[str, ...]:
        """Materials that a pane can be of."""
        solid = (MirrorMaterial, DielectricMaterial)
        return tuple(k for k, m in self.materials.items() if not isinstance(m, solid))

    @model_validator(mode="after")
    def _consistent(self) -> Case:
        if self.facade and self.room is None:
            raise InputError("case", "facade", "there is no room", "add a [room]")
        for name in ("wall", "open"):
            if name in self.materials:
                got = "strips use this name for no material"
                raise InputError("case", f"materials.{name}", got, "choose another name")
        check_components(self.components, self.materials, self.room is not None)
        if self.standing and isinstance(self.sun, Adaptive):
            got = "a mesh of suns would blur what components mirror"
            raise InputError("case", "sun.model", got, 'take "true_sun"')
        if self.unit is None:
            self._ask_about_lengths()
        self._check_effects()
        pieces = sum(piece.count[0] * piece.count[1] for piece in self.furniture)
        if pieces > MOST_PIECES:
            raise InputError("case", "furniture", f"{pieces} pieces", f"at most {MOST_PIECES}")
        points = self.sensors.count[0] * self.sensors.count[1]
        if points > MOST_SENSORS:
            raise InputError("case", "sensors.count", f"{points} points", f"at most {MOST_SENSORS}")
        for side, facade in self.facade.items():
            self._check_facade(side, facade)
        if self.shading is not None:
            name = self.shading.material
            scatters = (DiffuserMaterial, BsdfMaterial)
            if not isinstance(self.materials.get(name), scatters):
                known = [k for k, m in self.materials.items() if isinstance(m, scatters)]
                got = f"{shortened(name)} is no diffuser or bsdf in [materials]"
                raise InputError("case", "shading.material", got, choose(name, known))
        if self.design is not None:
            self._check_design(self.design)
        return self

    def _ask_about_lengths(self) -> None:
        """Ask about lengths that are hardly metres."""
        if self.room is None:
            ask_about_spacing(self.sensors.spacing)
            return
        ask_about_room(self.room.size)
        for i, piece in enumerate(self.furniture):
            ask_about_furniture(f"furniture.{i}", piece.corner, piece.size, self.room.size)

    def _check_effects(self) -> None:
        """Refuse choices that the model of the sun cannot follow."""
        chosen = self.effects
        if isinstance(self.sun, ThreePhase):
            for name in ("sky", "suns"):
                if getattr(chosen, name) == "off":
                    got = "a three-phase sun is among the patches of the sky"
                    remedy = 'leave it "auto", or take another sun.model'
                    raise InputError("case", f"effects.{name}", got, remedy)
        if isinstance(self.sun, Adaptive) and chosen.pane_to_pane == "all":
            got = "a mesh of suns would blur what panes mirror"
            raise InputError("case", "effects.pane_to_pane", got, 'take sun.model = "true_sun"')

    def _check_design(self, design: Design) -> None:
        """Refuse a design of unknown materials, or of a façade that is not there."""
        if self.room is None:
            raise InputError("case", "design", "there is no room", "add a [room]")
        if design.component is not None:
            self._check_turned(design.component)
            return
        clear = [k for k, m in self.materials.items() if isinstance(m, GlazingMaterial)]
        for key, name, known in (
            ("film", design.film, [k for k in self.panes if k not in clear]),
            ("clear", design.clear, clear),
        ):
            if name is not None and name not in known:
                got = f"{shortened(name)} is no such material in [materials]"
                raise InputError("case", f"design.{key}", got, choose(name, known))
        if design.film == design.clear:
            raise InputError("case", "design.film", "it is the clear one", "name another material")
        if design.band is not None and design.band[1] > self.room.size[2]:
            got = f"the room is {self.room.size[2]:g} m high"
            raise InputError("case", "design.band", got, "lower its upper edge")
        glazed = self.glazed
        if design.side is None and len(glazed) != 1:
            got = f"{len(glazed)} sides have panes"
            raise InputError("case", "design.side", got, 'name one, side = "south"')
        bare = design.side is not None and design.side not in glazed
        if bare and (design.band is None or design.wwr == "fixed"):
            got = f"the {design.side} side has no panes"
            raise InputError("case", "design.side", got, "give band and wwr = [low, high]")

    def _check_turned(self, name: str) -> None:
        """Refuse to tilt what is no structure, or stands nowhere."""
        known = [k for k, c in self.components.items() if isinstance(c, StructureComponent)]
        where = "design.component"
        if name not in known:
            got = f"{shortened(name)} is no structure in [components]"
            raise InputError("case", where, got, choose(name, known))
        if name not in self.standing:
            got = f"{shortened(name)} stands nowhere"
            raise InputError("case", where, got, "name it as the material of a strip")

    def _check_facade(self, side: Side, facade: Facade) -> None:
        """Refuse strips that do not fit into their wall, or of an unknown material."""
        assert self.room is not None
        structures = [k for k, c in self.components.items() if isinstance(c, StructureComponent)]
        known = ["wall", "open", *self.panes, *structures]
        named = [*self.materials, *self.components]
        facade.check(side, self.room.wall(side), known, named)

    def path(self, file: Path) -> Path:
        """Resolve a file that the case names: relative ones lie beside the case file."""
        return file if file.is_absolute() else self._folder / file

    def _with(self, **tables: object) -> Case:
        changed = self.model_copy(update=tables)
        changed._source, changed._folder = self._source, self._folder
        return changed

    def with_facade(self, side: Side, facade: Facade) -> Case:
        """Replace one façade.

        Raises
        ------
        InputError
            It does not fit into the room.
        """
        self._check_facade(side, facade)
        return self._with(facade={**self.facade, side: facade})

    def with_materials(self, materials: Mapping[str, Material]) -> Case:
        """Replace the materials; their names stay the same."""
        return self._with(materials=dict(materials))

    def with_components(self, components: Mapping[str, Component]) -> Case:
        """Replace the components; their names stay the same."""
        return self._with(components=dict(components))

    def moved(
        self,
        sensors: Sensors,
        furniture: tuple[Furniture, ...],
        components: Mapping[str, Component],
    ) -> Case:
        """Replace all that has coordinates where there is no room."""
        return self._with(sensors=sensors, furniture=furniture, components=dict(components))

    def with_dark_hours(self) -> Case:
        """Ask for the suns of all time stamps, for coefficients that any weather can use."""
        return self._with(effects=self.effects.model_copy(update={"dark_hours": "all"}))

    def without_shading(self) -> Case:
        """Leave the shade out."""
        return self._with(shading=None)

    def with_weather(self, file: Path | None) -> Case:
        """Replace the weather file; None keeps the case's own."""
        if file is None:
            return self
        return self._with(weather=WeatherFile(file=Path(file).absolute()))


def _is_file(path: Path, source: object, field: str) -> bool:
    """Whether a path names a file; a name that no file can have is refused."""
    try:
        return path.is_file()
    except OSError as error:
        remedy = "check the path and its rights"
        raise InputError(source, field, f"{path}: {error.strerror}", remedy) from None


def _locate(path: str | Path) -> Path:
    """Path of a case file or of a shipped case."""
    file = Path(path)
    if _is_file(file, path, "case file"):
        return file
    if str(path) in shipped_cases():
        return shipped_folder() / f"{path}.toml"
    near = difflib.get_close_matches(str(path), shipped_cases(), n=1)
    hint = f"did you mean the shipped case {near[0]}?" if near else "give a TOML file"
    raise InputError(path, "case file", "no such file", hint)


def load_case(path: str | Path) -> Case:
    """Read and check a case file.

    Parameters
    ----------
    path : str or Path
        A TOML file, or the name of a shipped case (`classroom/existing`).

    Returns
    -------
    Case

    Raises
    ------
    InputError
        The file is missing, is no TOML, has an unknown key or a value out of range.
    """
    file = _locate(path)
    data = read_toml(file, MAX_BYTES)
    case = checked(Case, data, file)
    case._source, case._folder = str(file), file.parent
    return _with_files(case)


def _with_files(case: Case) -> Case:
    """Resolve the files of materials and components, and refuse a case that lacks one."""

    def found(file: Path, field: str) -> Path:
        path = case.path(file)
        if not _is_file(path, case.source, field):
            remedy = "give its path relative to the case file"
            raise InputError(case.source, field, f"{file}: no such file", remedy)
        return path

    for name, material in case.materials.items():
        if isinstance(material, BsdfMaterial):
            path = found(material.file, f"materials.{name}.file")
            case.materials[name] = material.model_copy(update={"file": path})
    for name, component in case.components.items():
        if isinstance(component, StructureComponent | MeshComponent):
            key = "recipe" if isinstance(component, StructureComponent) else "file"
            path = found(getattr(component, key), f"components.{name}.{key}")
            case.components[name] = component.model_copy(update={key: path})
    return case
