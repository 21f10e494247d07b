"""Views of a case, traced once and shown at any instant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import fingerprint
from drcmitsuba.annual.choice import Choice
from drcmitsuba.case.case import Case
from drcmitsuba.case.effects import Sources
from drcmitsuba.case.groups import OPEN, State
from drcmitsuba.case.reading import load_case
from drcmitsuba.eye.openings import note_of
from drcmitsuba.picture.exr_header import BT709
from drcmitsuba.picture.picture import RADIANCE, Picture
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering import stored_view
from drcmitsuba.rendering.asked_view import AskedView, effects_of_view
from drcmitsuba.rendering.coefficient_pictures import coefficient_pictures
from drcmitsuba.rendering.hour import luminance
from drcmitsuba.rendering.light_paths import trace
from drcmitsuba.rendering.outside import OutsideLuminances
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.rendering.rendering import Rendering, Source, file_name
from drcmitsuba.rendering.traced_view import TracedView
from drcmitsuba.rendering.view_by_element import ViewByElement
from drcmitsuba.rendering.view_colours import ViewColours
from drcmitsuba.rendering.view_facade import ViewFacade
from drcmitsuba.rendering.view_of_case import (
    COLUMNS,
    Instant,
    Size,
    in_the_scene,
    instant_of,
    picture_view,
    shape_of,
    with_square_pixels,
)
from drcmitsuba.rendering.view_parts import ViewFrame, traced
from drcmitsuba.runtime import backend, storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, part, silent
from drcmitsuba.runtime.provenance import program
from drcmitsuba.scene.fills import Fills
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import Daylight, daylight, period, weather_of

SOURCES: Mapping[Source, Sources] = {
    "all": Sources(), "sky": Sources(sun=0.0), "sun": Sources(sky=0.0, ground=0.0),
}  # fmt: skip
"""Sources that a picture shows."""


FILMS = (
    "the picture leaves out light that reaches films by way of components or of other panes that "
    "scatter; illuminance and glare of a year have it"
)
"""Note on films where photons are followed."""
DIFFUSERS = (
    "the picture leaves out light that components throw on diffusing panes, which lie in too many "
    "planes; illuminance and glare of a year have it"
)
"""Note on such panes."""


@dataclass(frozen=True, eq=False)
class PreparedView:
    """View of a case whose light paths are traced, for all states of its façade."""

    case: Case
    name: str
    view: PictureView
    """View in the coordinates of the case [m]."""
    facade: ViewFacade
    channels: tuple[ViewByElement, ...]
    """Light paths in every colour channel, or by luminance."""
    colours: ViewColours | None = None
    """Light paths in bands, of a case that has them."""

    @property
    def state(self) -> State:
        """State of the façade that pictures show unless they are asked for another one."""
        return self.facade.state

    @property
    def fills(self) -> dict[str, tuple[str, ...]]:
        """Names of the fills by opening; the first one is what the case draws there."""
        return self.facade.fills

    def at(
        self, time: Instant, source: Source = "all", state: State | None = None,
        choice: Choice | None = None,
    ) -> Rendering:  # fmt: skip
        """Picture at an instant and in any state of the façade, without tracing again.

        Parameters
        ----------
        time : str, np.datetime64 or datetime
            Local standard time, such as "03-21 10:30".
        source : {"all", "sky", "sun"}
            Light that is shown: of sky and sun, of the sky and the ground, or of the sun; the last
            two add up to the first.
        state : str, optional
            State of the façade, such as `shaded`; by default that of `prepare`.
        choice : mapping, optional
            Name of a fill by opening, as for `annual.elements.Elements.evaluate`; openings that it
            does not name are as in the state.

        Returns
        -------
        Rendering

        Raises
        ------
        InputError
            The time is no instant of the weather, the source is none of these, or there is no such
            state, opening or fill.
        """
        instant = instant_of(time)
        light = daylight(self.case, np.array([instant]))
        of_all = OutsideLuminances.of(self.case, light, 0)
        if source not in SOURCES:
            raise InputError("picture", "source", repr(source), "give all, sky or sun")
        sources = self.case.effects.sources.and_of(SOURCES[source])
        outside, sky = of_all.times(*sources), sources.of_bins(light.sky["sky"].values[0])
        state = self.facade.state if state is None else state
        indices = self.facade.indices(state, choice or {}, light)
        views = [view.in_state(indices) for view in self.channels]
        shown = [luminance(view, outside, sky) for view in views]
        names = ("mean", "error", "disk")
        mean, error, disk = (np.stack([getattr(one, name) for one in shown]) for name in names)
        weights = np.array([*LUMINANCE_WEIGHTS.values()], np.float32)
        coloured = len(shown) > 1
        if coloured:  # the channels share their random numbers
            error, disk = (np.tensordot(weights, v, 1)[None] for v in (error, disk))
        rgb = np.moveaxis(mean if coloured else np.repeat(mean, 3, axis=0), 0, -1)
        if self.colours is not None:
            coloured = True
            rgb = self.colours.rgb(mean[0], light, of_all, indices, sources)
        date = str(instant.astype("datetime64[s]"))
        picture = Picture(
            np.ascontiguousarray(rgb), self.view, BT709 if coloured else RADIANCE,
            captured=date.replace("-", ":").replace("T", " "),
        )  # fmt: skip
        again = max(one.cells.again for one in self.channels)
        notes = (*_notes(self.case, instant, light), *note_of(again), *_lacking(views[0]))
        return Rendering(
            picture, error[0], disk[0], self.case.accuracy.replicates - 1, self.case.name,
            self.name, self.facade.told(state, choice or {}, indices), instant, source, notes,
        )  # fmt: skip

    @property
    def nbytes(self) -> int:
        """Size of the light paths by channel [bytes], at most."""
        return sum(one.nbytes for one in self.channels)

    def again(self, seed: int, folder: Path | None = None) -> PreparedView:
        """Trace the same view with other random numbers, the light on its surfaces, too.

        Bands, which tell the chromaticity alone, stay as they are.

        Parameters
        ----------
        seed : int
            Seed in place of `accuracy.seed` of the case.
        folder : Path, optional
            Folder for the light paths; without it they stay in memory.

        Returns
        -------
        PreparedView
        """
        channels = []
        for i, one in enumerate(self.channels):
            keep, here = None, None
            if folder is not None:
                here = folder / f"channel_{i}"
                here.mkdir()
                keep = partial(stored_view.save_paths, folder=here)
            again = trace(
                one.scenes, one.view, one.rows, one.columns, sampling=one.sampling,
                accuracy=one.accuracy.model_copy(update={"seed": seed}),
                subdivision=one.subdivision, diameter=one.diameter, keep=keep,
            )  # fmt: skip
            if here is not None:
                (again,) = stored_view.with_tiles_of([again], [here])
            channels.append(again)
        return replace(self, channels=tuple(channels))

    def save_bins(self, folder: str | Path, done: Progress = lambda share: None) -> list[Path]:
        """Write the coefficient pictures of ground and sky patches, each whole or not at all.

        The façade is in the state of `prepare`.

        Parameters
        ----------
        folder : str or Path
            Folder for `NAME_bins.zarr`, or one such for each colour channel.
        done : callable
            Takes the share of the work that is done.

        Returns
        -------
        list of Path
            Zarr folders with `coefficient` and `coefficient_se` (row, column, bin) [1].
        """
        colours = list(LUMINANCE_WEIGHTS) if len(self.channels) > 1 else [""]
        paths, indices = [], self.facade.indices(self.facade.state, {}, daylight(self.case))
        for i, (colour, one) in enumerate(zip(colours, self.channels, strict=True)):
            share = part(done, i / len(colours), (i + 1) / len(colours))
            state = "" if self.facade.state == OPEN else f"_{file_name(self.facade.state)}"
            name = f"{file_name(self.name)}{state}_bins{'_' if colour else ''}{colour}.zarr"
            storage.save_zarr(_told(one.in_state(indices), share), Path(folder) / name, along="row")
            paths.append(Path(folder) / name)
        return paths


def _told(view: TracedView, done: Progress) -> Iterator[xr.Dataset]:
    """Coefficient pictures, and the share that is written so far."""
    for rows in coefficient_pictures(view):
        yield rows
        done((int(rows["row"][-1]) + 1) / view.rows)


def _lacking(view: TracedView) -> tuple[str, ...]:
    """Notes on light of photons that a picture does not show."""
    notes, world, photons = [], view.scene, view.caustics
    if world.films and world.followed:
        notes.append(FILMS)
    if photons is not None and photons.panes is None and any(view.glow.table.faces):
        notes.append(DIFFUSERS)
    return tuple(notes)


def _notes(case: Case, instant: np.datetime64, light: Daylight) -> tuple[str, ...]:
    """Remarks on an instant without daylight, or outside of the case's period."""
    notes, when = [], str(instant.astype("datetime64[m]"))[5:].replace("T", " ")
    here = light.sky.isel(time=0)
    if not (here["sky"].values > 0).any() and float(here["sun"]) <= 0:
        notes.append(f"{when}: neither sky nor sun shines, the picture is dark")
    if case.period.timestamps is None:
        w = weather_of(case)
        starts = w.data["time"].values
        hour = starts[np.searchsorted(starts, instant, side="right") - 1]
        if hour not in period(case.period).select(starts, w.step)[0]:
            notes.append(f"{when} is outside of the period of the case")
    return tuple(notes)


def prepare(
    case: Case | str | Path, view: str | None = None, *, size: Size = COLUMNS,
    sampling: Sampling | None = None, state: State = OPEN, states: Sequence[State] = (),
    fills: Fills = (), folder: str | Path | None = None, stage: Stage = silent,
) -> PreparedView:  # fmt: skip
    """Trace the light paths of a view, for all states of its façade.

    Parameters
    ----------
    case : Case, str or Path
        Case, TOML file, or name of a shipped case.
    view : str, optional
        Name of a view of the case; not needed where it has one only.
    size : int or tuple of int
        Number of columns, or of columns and rows.
    sampling : Sampling, optional
        Numbers of rays.
    state : str
        State of the façade that pictures show unless they are asked for another one. Where states
        have surfaces of their own, light paths are traced in this one alone.
    states : sequence of str, optional
        States that pictures will show; by default all, and any choice of fills. Light paths of one
        state alone take about half of the time.
    fills : sequence of str, or mapping of str to sequence of str, optional
        Further fills of all openings, or of some by their names, as for `drcmitsuba.elements`. By
        default what the case itself may put there.
    folder : str or Path, optional
        Folder for the light paths, about 1 KB a pixel; those of the same view are not traced again.
        Without it they stay in memory.
    stage : callable, optional
        Shows the stages of the work.

    Returns
    -------
    PreparedView

    Raises
    ------
    InputError
        The view, the size, the state, a fill, a material or the geometry is unfit.

    Examples
    --------
    >>> from drcmitsuba import rendering
    >>> desk = rendering.prepare("desk.toml", "desk", size=16)
    >>> [desk.at("03-20 10:00", state=state).state for state in ("open", "shaded")]
    ['open', 'shaded']
    """
    if not isinstance(case, Case):
        case = load_case(case)
    backend.select()
    name, shown = picture_view(case, view)
    rows, columns = shape_of(shown, size)
    shown = with_square_pixels(case, name, shown, rows, columns)
    with stage("plan"):
        facade = ViewFacade.of(case, state, fills)
        effects = effects_of_view(facade, fills, rows * columns)
    sampling = (sampling or Sampling()).rounded(case.accuracy.replicates)
    stated = {
        "case": fingerprint(case, effects), "view": shown.options(), "rows": rows,
        "columns": columns, "seed": case.accuracy.seed,
        "format": stored_view.FORMAT, "program": program(),
    }  # fmt: skip
    frame = ViewFrame(
        in_the_scene(case, shown), rows, columns, case.sky.subdivision, case.outside.sun_diameter
    )
    if {*states} == {state} and not fills:
        facade = facade.alone()
    there = None if folder is None else Path(folder)
    asked = AskedView(name, facade, effects, sampling, stated, there)
    views = traced(frame, asked.parts, asked.content, asked.path, stage)
    colours = None if asked.bands is None else ViewColours(asked.bands, views[asked.channels :])
    return PreparedView(case, name, shown, asked.facade, views[: asked.channels], colours)
