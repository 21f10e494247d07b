"""The command `render`: files of pictures, frames and coefficient pictures, and bad input."""

import errno
import json
import shutil
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.image import imread

from drcmitsuba import load_case, picture
from drcmitsuba.rendering import frames, prepare, render, rounds, stored_view
from drcmitsuba.runtime import provenance, storage
from drcmitsuba.runtime.errors import InputError
from tests.system.small_room import CASE, SHADING, changed, run

VIEW = "\n[views.desk]\nposition = [2.0, 3.5, 1.2]\ndirection = [0, -1, 0]\n"
DESK = '\n[[furniture]]\nname = "desk"\ncorner = [1.5, 3.0, 0.0]\nsize = [1, 1, 1.5]\n'
SMALL = ("--size", "24", "--view", "desk", "-o", "out")


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """Folder in which one view has been rendered at noon and for two frames."""
    folder = tmp_path_factory.mktemp("rendered")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        (folder / "room.toml").write_text(CASE + VIEW)
        (folder / "frames.csv").write_text("time\n2015-03-20T09:00\n2015-03-20T15:30\n")
        run(patch, "render", "room.toml", "--time", "03-20 12:00", *SMALL)
        false = ("--tone", "false", "--scale", "10,5000")
        run(patch, "render", "room.toml", "--times", "frames.csv", *false, *SMALL)
        run(patch, "render", "room.toml", "--bins", *SMALL)
    return folder


def test_a_picture_says_view_and_time_in_both_formats(rendered):
    shown = [picture.read(rendered / f"out/desk_03-20_1200{e}") for e in (".exr", ".hdr")]
    for one in shown:
        assert one.shape == (24, 24)
        assert one.view.kind == "equidistant"
        assert one.view.position == pytest.approx((2.0, 3.5, 1.2))
        assert one.captured == "2015:03:20 12:00:00"
    assert np.allclose(shown[0].luminance, shown[1].luminance, rtol=0.02, atol=1)
    assert (rendered / "out/desk_03-20_1200.png").read_bytes()[:4] == b"\x89PNG"


def test_the_exr_has_a_channel_of_standard_errors(rendered):
    import OpenEXR

    with OpenEXR.File(str(rendered / "out/desk_03-20_1200.exr"), separate_channels=True) as opened:
        error = opened.channels()["error"].pixels
    mean = picture.read(rendered / "out/desk_03-20_1200.exr").luminance
    assert ((error > 0) & (error < mean)).mean() > 0.5


def test_frames_and_bins_follow_without_tracing_again(rendered, monkeypatch):
    assert (rendered / "out/desk_03-20_0900.exr").exists()
    assert (rendered / "out/desk_03-20_1530_false.png").exists()
    with xr.open_zarr(rendered / "out/desk_bins.zarr") as bins:
        assert dict(bins.sizes) == {"row": 24, "column": 24, "bin": 146}
        assert float(bins["coefficient"].sum()) > 0
    monkeypatch.setattr(stored_view, "save_paths", None)  # tracing would call it
    monkeypatch.chdir(rendered)
    before = picture.read("out/desk_03-20_1200.hdr").rgb
    both = ("--time", "03-20 12:00", "--time", "03-20 13:00")
    run(monkeypatch, "render", "room.toml", *both, *SMALL)
    assert np.array_equal(before, picture.read("out/desk_03-20_1200.hdr").rgb)
    assert (rendered / "out/desk_03-20_1300.exr").exists()


def test_states_follow_without_tracing_again_each_in_its_own_file(rendered, monkeypatch):
    monkeypatch.chdir(rendered)
    states = ("--state", "open", "--state", "shaded")
    run(monkeypatch, "render", "room.toml", "--time", "03-20 15:00", *states, *SMALL)
    before = (rendered / "out/desk_03-20_1200.hdr").read_bytes()
    run(monkeypatch, "render", "room.toml", "--time", "03-20 12:00", *states[2:], *SMALL)
    assert (rendered / "out/desk_03-20_1200.hdr").read_bytes() == before  # of the open state
    monkeypatch.setattr(stored_view, "save_paths", None)  # tracing would call it
    run(monkeypatch, "render", "room.toml", "--time", "03-20 12:00", *states, *SMALL)
    files = (f"out/desk_03-20_1200{name}.hdr" for name in ("", "_open", "_shaded"))
    alone, is_open, shut = (picture.read(file).luminance.mean() for file in files)
    assert is_open == pytest.approx(alone, rel=0.02)
    assert 0 < shut < 0.5 * is_open
    kept = prepare("room.toml", "desk", size=24, folder="out").at("03-20 12:00", state="shaded")
    memory = prepare("room.toml", "desk", size=24).at("03-20 12:00", state="shaded")
    assert np.allclose(kept.picture.rgb, memory.picture.rgb, rtol=1e-4)


def test_pictures_of_the_sky_and_of_the_sun_add_up(rendered, monkeypatch):
    monkeypatch.chdir(rendered)
    parts = []
    for source in ("sky", "sun"):
        run(monkeypatch, "render", "room.toml", "--time", "03-20 12:00", "--source", source, *SMALL)
        parts.append(picture.read(f"out/desk_03-20_1200_{source}.exr").luminance)
        assert parts[-1].max() > 10
    whole = picture.read("out/desk_03-20_1200.exr").luminance
    assert np.allclose(sum(parts), whole, rtol=1e-4, atol=1e-2)
    for effect, left in (("suns", parts[0]), ("sky", None), ("ground", None)):
        text = CASE + VIEW + f'[effects]\n{effect} = "off"\n'
        (rendered / "off.toml").write_text(text)
        shown = prepare("off.toml", "desk", size=24).at("03-20 12:00").picture.luminance
        assert 0 < shown.mean() < 0.99 * whole.mean()
        if left is not None:
            assert shown.mean() == pytest.approx(left.mean(), rel=0.05)
    with pytest.raises(InputError, match="source: 'moon'; give all, sky or sun"):
        prepare("room.toml", "desk", size=8).at("03-20 12:00", "moon")


def test_frames_have_the_state_that_the_shade_takes_in_their_hour(rendered, monkeypatch, capsys):
    monkeypatch.chdir(rendered)
    (rendered / "day.csv").write_text("time\n2015-03-20T09:40\n2015-03-25T09:10\n")
    run(monkeypatch, "render", "room.toml", "--times", "day.csv", "--state", "applied", *SMALL)
    assert "façade shaded in 1, open in 1 of 2 pictures" in capsys.readouterr().out
    shown = {t: picture.read(f"out/desk_{t}_applied.exr").rgb for t in ("03-20_0940", "03-25_0910")}
    for state, (time, rgb) in zip(("shaded", "open"), shown.items(), strict=True):
        when = time[:8] + ":" + time[8:]
        fixed = prepare("room.toml", "desk", size=24, state=state).at(when.replace("_", " "))
        assert np.array_equal(rgb, fixed.picture.rgb)
        assert fixed.state == state


def test_tones_stand_beside_each_other_and_share_a_scale(rendered, monkeypatch, capsys):
    monkeypatch.chdir(rendered)
    noon, shown = ("render", "room.toml", "--time", "03-20 12:00", "--tone"), {}
    for tone, scale in (("exposure", "1,1e6"), ("exposure", "1,10"), ("false", "1,10")):
        run(monkeypatch, *noon, tone, "--scale", scale, *SMALL)
        shown[tone, scale] = imread(f"out/desk_03-20_1200_{tone}.png")[..., :3]
    assert "no weather file: the typical year of" in capsys.readouterr().out
    assert (rendered / "out/desk_03-20_1200.png").exists()
    dark, white = shown["exposure", "1,1e6"], shown["exposure", "1,10"]
    lit = picture.read("out/desk_03-20_1200.exr").luminance > 10
    assert dark[lit].max() < 0.6
    assert np.allclose(white[lit].max(axis=-1), 1)


@pytest.mark.slow
def test_a_picture_is_as_sure_as_a_target_asks(rendered, monkeypatch, capsys):
    """Its actual error, against a run of many more rays of another seed, is as it states."""
    monkeypatch.chdir(rendered)
    before = {path.name for path in (rendered / "out").iterdir()}
    wanted = ("--time", "03-20 14:00", "--target", "4 %", *SMALL, "--size", "48")
    run(monkeypatch, "render", "room.toml", *wanted)
    said = capsys.readouterr().out
    assert "03-20 14:00: luminance of a pixel ±" in said
    assert "wanted ±4 %" in said
    left = {path.name for path in (rendered / "out").iterdir()} - before
    assert left == {f"desk_03-20_1400{ending}" for ending in (".exr", ".hdr", ".png")}

    case, common = load_case("room.toml"), {"size": 48, "time_limit": 600}
    shown = render(case, "desk", "03-20 14:00", target="4 %", **common)
    written = picture.read("out/desk_03-20_1400.exr").luminance
    assert np.allclose(written, shown.picture.luminance, rtol=1e-5)
    once = render(case, "desk", "03-20 14:00", size=48)
    assert once.half_width > 4 >= shown.half_width
    other = case.with_tables(accuracy=case.accuracy.model_copy(update={"seed": 5}))
    true = render(other, "desk", "03-20 14:00", target="2 %", **common)
    assert true.half_width <= 2
    variance = (shown.error.astype(float) ** 2 + true.error.astype(float) ** 2).ravel()
    weight = variance / variance.sum()
    difference = (shown.picture.luminance - true.picture.luminance).astype(float)
    ratio = (difference**2).sum() / variance.sum()
    # Pixels at edges decide, each with its own rays and an error that is itself an estimate.
    spread = np.sqrt(2 * (weight**2).sum() * (1 + 1 / shown.freedom))
    assert abs(ratio - 1) < 3 * spread, f"{ratio:.2f} ± {spread:.2f}"
    assert 3 * spread < 1


def test_rounds_that_may_not_fit_in_memory_lie_on_the_disk(rendered, monkeypatch):
    monkeypatch.chdir(rendered)
    common = {"size": 24, "target": "20 %", "time_limit": 600}
    (kept,) = frames("room.toml", "desk", ["03-20 12:00"], **common)
    assert kept.freedom > 3
    monkeypatch.setattr(rounds, "MOST_MEMORY", 0)
    (spilt,) = frames("room.toml", "desk", ["03-20 12:00"], folder="out", **common)
    assert np.allclose(kept.picture.rgb, spilt.picture.rgb, rtol=1e-5)
    assert spilt.freedom == kept.freedom
    assert not list((rendered / "out").glob("round_*"))


def test_another_view_or_case_is_traced_anew(rendered, monkeypatch, tmp_path):
    monkeypatch.chdir(rendered)
    (tmp_path / "dark.toml").write_text(CASE.replace("0.65", "0.325") + VIEW)
    before = picture.read("out/desk_03-20_1200.hdr").luminance.mean()
    dark = ("render", tmp_path / "dark.toml", "--time", "03-20 12:00")
    run(monkeypatch, *dark, "--size", "24", "-o", tmp_path / "out")
    after = picture.read(tmp_path / "out/desk_03-20_1200.hdr").luminance.mean()
    assert after == pytest.approx(before / 2, rel=0.1)


def test_a_night_is_a_dark_picture_and_said(rendered, monkeypatch, capsys):
    monkeypatch.chdir(rendered)
    run(monkeypatch, "render", "room.toml", "--time", "12-21 23:00", *SMALL)
    said = capsys.readouterr().out
    assert "12-21 23:00: neither sky nor sun shines, the picture is dark" in said
    assert "12-21 23:00 is outside of the period of the case" in said
    assert picture.read("out/desk_12-21_2300.exr").luminance.max() == 0


@pytest.mark.parametrize(
    ("case", "options", "line"),
    [
        (CASE, ("--time", "03-20 12:00"), "views: none; add a table [views.NAME]"),
        (CASE + VIEW + DESK, ("--time", "03-20 12:00"), "lies in or on 'desk'"),
        (
            CASE + VIEW.replace("2.0, 3.5, 1.2", "2.0, 5.0, 1.2"), ("--time", "03-20 12:00"),
            "in, on or beyond a wall of the room",
        ),
        (
            CASE + VIEW.replace("[0, -1, 0]", "[0, 0, -1]"), ("--time", "03-20 12:00"),
            "views.desk.up: [0.0, 0.0, 1.0] along the direction",
        ),
        (CASE + VIEW, (), "--time, --times, --bins: none of them; give one of them"),
        (CASE + VIEW, ("--time", "noon"), "--time: 'noon'; give month, day and"),
        (CASE + VIEW, ("--time", "02-30 12:00"), "--time: '02-30 12:00'; give month, day and"),
        (CASE + VIEW, ("--time", "03-20 12:00", "--view", "door"), "--view: 'door'; give one of"),
        (CASE + VIEW, ("--bins", "--size", "wide"), "--size: 'wide'; give 512 or 800x600"),
        (
            CASE + VIEW, ("--time", "03-20 12:00", "--tone", "false", "--scale", "9,1"),
            "scale: 9 to 1; give 0 < least < most",
        ),
        (
            CASE + VIEW, ("--time", "03-20 12:00", "--scale", "1,9"),
            'tone "human" has no scale; give tone "false" or "exposure"',
        ),
        (
            CASE + VIEW, ("--time", "03-20 12:00", "--scale", "bright"),
            "--scale: 'bright'; give least and most",
        ),
        (CASE + VIEW, ("--bins", "--size", "99999"), "size: 99999 by 99999 pixels; give 1 to"),
        (CASE + VIEW, ("--bins", "--size", "5000"), "MB on the disk; give a smaller size"),
        (CASE + VIEW, ("--bins", "--samples", "0"), "samples: 0; give 1 to"),
        (CASE + VIEW, ("--bins", "--target", "2 %"), "--target: given with --bins; bins have no"),
        (CASE + VIEW, ("--bins", "--time-limit", "9"), "given without --target; give --target"),
        (CASE + VIEW, ("--time", "03-20 12:00", "--target", "1 point"), 'write "2 %", of the'),
        (CASE + VIEW, ("--bins", "--state", "applied"), "with --bins; bins have no hour"),
        (CASE + VIEW, ("--bins", "--state", "open", "--state", "shaded"), "bins have no hour"),
        (
            changed((SHADING, "")) + VIEW, ("--time", "03-20 12:00", "--state", "applied"),
            "shading: none; add [shading] or [groups] to the case, or give another state",
        ),
        (CASE + VIEW, ("--bins", "--state", "ajar"), 'no state "ajar"; choose from: "open"'),
    ],
)  # fmt: skip
def test_bad_input_is_one_line(case, options, line, monkeypatch, capsys, tmp_path):
    free = shutil._ntuple_diskusage(1 << 40, 1 << 40, 1 << 33)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: free)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room.toml").write_text(case)
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, "render", "room.toml", *options)
    said = capsys.readouterr().err
    assert stop.value.code == 2
    assert line in said
    assert said.count("\n") == 1
    assert not (tmp_path / "results").exists()


def test_a_full_disk_leaves_nothing(monkeypatch, capsys, tmp_path):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device", "out")

    monkeypatch.chdir(tmp_path)
    (tmp_path / "room.toml").write_text(CASE + VIEW)
    monkeypatch.setattr(storage.zarr_folder, "write", full)
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, "render", "room.toml", "--time", "03-20 12:00", *SMALL)
    assert stop.value.code == 2
    assert "No space left on device" in capsys.readouterr().err
    assert list((tmp_path / "out").iterdir()) == []


def test_light_paths_of_another_method_are_traced_again(rendered, monkeypatch, capsys, tmp_path):
    """Their statement left out the method, so that pictures kept the light of an older one."""
    shutil.copytree(rendered, tmp_path / "copy")
    monkeypatch.chdir(tmp_path / "copy")
    stated = Path("out/desk_open_light_paths/channel_0/view.json")
    before = json.loads(stated.read_text())
    monkeypatch.setattr(provenance, "METHOD", provenance.METHOD + 1)
    stages = []

    @contextmanager
    def stage(name):
        stages.append(name)
        yield lambda share: None

    prepare("room.toml", "desk", size=24, states=["open"], folder="out", stage=stage)
    assert "rays, again: those stored are of another version" in stages
    now = json.loads(stated.read_text())
    assert now["program"]["method"] == str(provenance.METHOD)
    assert {**now, "program": before["program"]} == before


def test_light_paths_that_are_damaged_are_refused(rendered, monkeypatch, capsys, tmp_path):
    shutil.copytree(rendered, tmp_path / "copy")
    monkeypatch.chdir(tmp_path / "copy")
    shutil.rmtree("out/desk_open_light_paths/channel_0/cells.zarr")
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, "render", "room.toml", "--time", "03-20 12:00", *SMALL)
    assert stop.value.code == 2
    assert "delete the folder of the view" in capsys.readouterr().err
