"""Pictures in files: what is written comes back, and Radiance reads and writes the same."""

import numpy as np
import OpenEXR
import pytest

from drcmitsuba import picture
from drcmitsuba.picture import Picture, PictureView, exr, hdr
from drcmitsuba.runtime.errors import InputError
from tests import SHARED, radiance, skips

VIEW = PictureView("equidistant", (1.0, 0.5, 0.0), (0.0, 0.0, 1.0), (180.0, 170.0), (1.0, 2.0, 1.2))
TESTIMAGE = SHARED / "data" / "pictures" / "evalglare_testimage.hdr"


def sample(rows=12, columns=40, seed=0):
    """Picture of eight decades with rows that are noise, constant, and mixed."""
    rgb = np.exp(np.random.default_rng(seed).uniform(-5, 13, (rows, columns, 3))).astype(np.float32)
    rgb[1:3] = 7.5
    rgb[3, 5:25] = 0
    return Picture(rgb, VIEW, captured="2003:12:15 17:44:01")


def written(path, header=b"", resolution=b"-Y 1 +X 3", pixels=b"\x80\x40\x20\x81" * 3):
    path.write_bytes(b"#?RADIANCE\n" + header + b"\n" + resolution + b"\n" + pixels)
    return path


@pytest.mark.parametrize("columns", [1, 7, 8, 40, 300])
def test_a_radiance_picture_comes_back_within_its_eight_bits(columns, tmp_path):
    saved = sample(columns=columns)
    picture.save(saved, tmp_path / "a.hdr")
    read = picture.read(tmp_path / "a.hdr")
    step = saved.rgb.max(axis=2, keepdims=True) / 128  # the mantissa of the brightest channel
    assert (np.abs(read.rgb - saved.rgb) <= step / 2 + 1e-6).all()
    assert (read.view, read.captured) == (VIEW, saved.captured)


def test_the_exposure_of_a_radiance_picture_is_divided_out(tmp_path):
    saved = sample()
    hdr.save(saved, tmp_path / "a.hdr", exposure=1 / 64)
    hdr.save(saved, tmp_path / "b.hdr")
    exposed, plain = picture.read(tmp_path / "a.hdr"), picture.read(tmp_path / "b.hdr")
    assert exposed.exposure == 1 / 64
    np.testing.assert_allclose(exposed.rgb, plain.rgb, rtol=1e-6)


def test_exposures_and_corrections_of_several_programs_are_multiplied(tmp_path):
    lines = b"EXPOSURE=2\n\tEXPOSURE=100\nEXPOSURE=4\nCOLORCORR= 1 2 .5\nCOLORCORR= 1 1 .5\n"
    read = picture.read(written(tmp_path / "a.hdr", lines))
    value = np.array([0x80, 0x40, 0x20]) + 0.5
    np.testing.assert_allclose(read.rgb[0, 0], 179 * value / 128 / (8 * np.array([1, 2, 0.25])))
    assert read.exposure == 8
    assert read.view is None
    np.testing.assert_allclose(read.luminance, read.rgb @ [0.265, 0.670, 0.065], rtol=1e-6)


def test_views_of_several_lines_are_one_view(tmp_path):
    lines = b"VIEW= -vth -vh 180 -vv 180 -vp 1 2 3\nVIEW= -vs .25 -vv 90\n\tVIEW= -vtv\n"
    view = picture.read(written(tmp_path / "a.hdr", lines)).view
    assert (view.kind, view.angles, view.shift) == ("hemispherical", (180, 90), 0.25)
    assert view.position == (1, 2, 3)


@pytest.mark.parametrize("rows", "-+")
@pytest.mark.parametrize("columns", "+-")
@pytest.mark.parametrize("by_column", [False, True])
def test_any_order_of_scanlines_gives_the_same_picture(rows, columns, by_column, tmp_path):
    quads = np.random.default_rng(1).integers(2, 250, (5, 9, 4), dtype=np.uint8)
    quads[..., 3] = 130
    upright = picture.read(written(tmp_path / "a.hdr", b"", b"-Y 5 +X 9", quads.tobytes()))
    turned = quads[:: 1 if rows == "-" else -1, :: 1 if columns == "+" else -1]
    words = [f"{rows}Y 5", f"{columns}X 9"]
    if by_column:
        turned, words = turned.swapaxes(0, 1), words[::-1]
    file = written(tmp_path / "b.hdr", b"", " ".join(words).encode(), turned.tobytes())
    np.testing.assert_array_equal(picture.read(file).rgb, upright.rgb)


def test_repeats_of_pixels_are_digits_of_one_number(tmp_path):
    pixels = b"\x80\x40\x20\x81" + b"\1\1\1\x05" + b"\1\1\1\x01" + b"\x10\x40\x20\x81"
    read = picture.read(written(tmp_path / "a.hdr", b"", b"-Y 1 +X 263", pixels)).rgb[0]
    assert (read[:262] == read[0]).all()
    assert read[262, 0] != read[0, 0]


def test_a_picture_in_xyz_has_the_luminance_of_its_y(tmp_path):
    read = picture.read(written(tmp_path / "a.hdr", b"FORMAT=32-bit_rle_xyze\n"))
    np.testing.assert_allclose(read.luminance, 179 * 64.5 / 128, rtol=2e-3)


def test_other_primaries_give_other_luminance(tmp_path):
    lines = b"PRIMARIES= .64 .33 .3 .6 .15 .06 .3127 .329\n"
    read = picture.read(written(tmp_path / "a.hdr", lines))
    np.testing.assert_allclose(read.weights, [0.2126, 0.7152, 0.0722], atol=2e-4)


@pytest.mark.parametrize(("pixels", "digits"), [("float", 1e-7), ("half", 6e-4)])
def test_an_openexr_picture_comes_back_with_its_header(pixels, digits, tmp_path):
    saved = sample()
    exr.save(saved, tmp_path / "a.exr", pixels)
    read = picture.read(tmp_path / "a.exr")
    smallest = saved.rgb.max() * 1e-9  # halves end there
    np.testing.assert_allclose(read.rgb, saved.rgb, rtol=digits, atol=smallest)
    assert (read.view, read.captured, read.primaries) == (VIEW, saved.captured, saved.primaries)


def test_openexr_without_luminance_of_white_is_in_radiances_unit(tmp_path):
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": np.ones((2, 3), np.float32)}) as made:
        made.write(str(tmp_path / "a.exr"))
    read = picture.read(tmp_path / "a.exr")
    np.testing.assert_allclose(read.rgb, 179)
    np.testing.assert_allclose(read.luminance, 179)


@skips.RADIANCE.mark
def test_radiance_reads_what_is_written_and_writes_what_is_read(tmp_path):
    saved = sample()
    picture.save(saved, tmp_path / "a.hdr")
    shown = radiance.run(["pvalue", "-h", "-H", "-d", "-df", "a.hdr"], tmp_path)
    values = np.frombuffer(shown, np.float32).reshape(saved.rgb.shape) * 179
    read = picture.read(tmp_path / "a.hdr")
    np.testing.assert_allclose(values, read.rgb, rtol=1e-6)
    filtered = radiance.run(["pfilt", "-1", "-e", "0.25", "a.hdr"], tmp_path)
    (tmp_path / "b.hdr").write_bytes(filtered)
    np.testing.assert_allclose(picture.read(tmp_path / "b.hdr").rgb, read.rgb, rtol=1e-5)


@skips.needs(TESTIMAGE)
def test_the_test_picture_has_the_mean_luminance_that_evalglare_gives():
    read = picture.read(TESTIMAGE)
    cosine = read.directions() @ read.view.frame[2]
    seen = read.solid_angles() * (cosine > 0)
    assert (read.luminance * seen * cosine).sum() == pytest.approx(6124.94, rel=1e-5)
    assert (read.luminance * seen).sum() / seen.sum() == pytest.approx(1729.70, rel=1e-5)


@pytest.mark.parametrize(
    ("header", "resolution", "pixels", "complaint"),
    [
        (b"FORMAT=32-bit_rle\n", b"-Y 1 +X 3", b"", "32-bit_rle;"),
        (b"EXPOSURE=0\n", b"-Y 1 +X 3", b"", "line 2: EXPOSURE: 0"),
        (b"EXPOSURE=nan\n", b"-Y 1 +X 3", b"", "line 2: EXPOSURE: nan"),
        (b"EXPOSURE=1e29\nEXPOSURE=1e29\n", b"-Y 1 +X 3", b"", "1e+58"),
        (b"COLORCORR= 1 2\n", b"-Y 1 +X 3", b"", "3 in all"),
        (b"PRIMARIES= 0 0 0 0 0 0 0 0\n", b"-Y 1 +X 3", b"", "line 2: PRIMARIES"),
        (b"VIEW= -vtq\n", b"-Y 1 +X 3", b"", "line 2: view: -vtq"),
        (b"VIEW= -vth -vh 190\n", b"-Y 1 +X 3", b"", "up to 180"),
        (b"VIEW= -vd 0 0 1\n", b"-Y 1 +X 3", b"", "-vd along -vu"),
        (b"", b"-Y 1 -Y 3", b"", "resolution: -Y 1 -Y 3"),
        (b"", b"-Y 0 +X 3", b"", "size: 3 by 0"),
        (b"", b"-Y 999999999 +X 999999999", b"", "403 MB"),
        (b"", b"-Y 1 +X 3", b"\x80\x40\x20\x81", "scanline 1 of 1"),
        (b"", b"-Y 1 +X 3", b"\1\1\1\1" * 3, "scanline 1 of 1"),
        (b"", b"-Y 1 +X 3", b"\5\1\1\1" + b"\1\1\1\0" * 9, "scanline 1 of 1"),
        (b"", b"-Y 1 +X 9", b"\2\2\0\x08" + b"\x89\1" * 4, "scanline 1 of 1"),
        (b"", b"-Y 1 +X 9", b"\2\2\0\x09" + b"\x8a\1" * 4, "scanline 1 of 1"),
        (b"", b"-Y 1 +X 9", b"\2\2\0\x09" + b"\0" * 9, "scanline 1 of 1"),
        (b"", b"-Y 1 +X 3", b"\x80\x40\x20\xff" * 3, "pixel (0, 0) from the top left"),
    ],
)
def test_an_unfit_radiance_picture_is_refused_in_one_line(
    header, resolution, pixels, complaint, tmp_path
):
    with pytest.raises(InputError) as error:
        picture.read(written(tmp_path / "a.hdr", header, resolution, pixels))
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (b"\x76\x2f\x31\x01\x02\x00\x00", b"\x76\x2f\x31\x01\x02\x08\x00", "deep pixels"),
        (b"\x27\x00\x00\x00\x0b\x00\x00\x00", b"\xff\xff\xff\x6f\xff\xff\xff\x6f", "403 MB"),
        (b"dataWindow", b"dateWindow", "dataWindow"),
        (b"R\0\2\0", b"Q\0\2\0", "channels: B, G, Q"),
        (b"-vta -vp", b"-vta -vx", "'-vx' in a view"),
    ],
)
def test_an_unfit_openexr_header_is_refused_in_one_line(old, new, complaint, tmp_path):
    exr.save(sample(), tmp_path / "a.exr")
    raw = (tmp_path / "a.exr").read_bytes()
    assert old in raw
    (tmp_path / "a.exr").write_bytes(raw.replace(old, new))
    with pytest.raises(InputError) as error:
        picture.read(tmp_path / "a.exr")
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("ending", [".hdr", ".exr"])
def test_a_picture_that_breaks_off_anywhere_is_refused(ending, tmp_path):
    file = tmp_path / f"a{ending}"
    picture.save(sample(), file)
    raw = file.read_bytes()
    for end in range(0, len(raw), 97):
        file.write_bytes(raw[:end])
        with pytest.raises(InputError):
            picture.read(file)


def test_other_files_and_endings_are_refused(tmp_path):
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n")
    with pytest.raises(InputError, match="format"):
        picture.read(tmp_path / "a.png")
    with pytest.raises(InputError, match="no such file"):
        picture.read(tmp_path / "gone.hdr")
    with pytest.raises(InputError, match=r"ending: \.png"):
        picture.save(sample(), tmp_path / "b.png")
    with pytest.raises(InputError, match=r"pixel \(2, 1\) from the top left"):
        Picture(np.pad([[[np.nan] * 3]], ((1, 0), (2, 0), (0, 0))))


@pytest.mark.parametrize(
    ("line", "angle"),
    [
        (b"rpict -vta -vp 0 0 1.2 -vd 0 1 0 -vu 0 0 1 -vh 180 -vv 180 -x 400 scene.oct", 180),
        (b"/usr/bin/rpict -ab 2 -vta -vd 0 1 0 -vh 120 -vv 120 scene.oct", 120),
        (b"rpict -vta -vd 0 1 0 -vh 90 -vv 90\nVIEW= -vh 60 -vv 60", 60),
    ],
)
def test_a_view_is_that_of_the_command_line(tmp_path, line, angle):
    """Such pictures had no view, which evalglare reads."""
    view = picture.read(written(tmp_path / "a.hdr", line + b"\n")).view
    assert view.kind == "equidistant"
    assert view.direction == (0, 1, 0)
    assert view.angles == (angle, angle)


@pytest.mark.parametrize(
    "line", [b"\trpict -vta -vh 180 -vv 180", b"pfilt -x 400", b"rpict scene.oct", b"rpict -vp 1"]
)
def test_other_command_lines_state_no_view(tmp_path, line):
    assert picture.read(written(tmp_path / "a.hdr", line + b"\n")).view is None


def test_a_header_with_carriage_returns_is_read(tmp_path):
    """It was no picture of Radiance."""
    plain = written(tmp_path / "a.hdr", b"VIEW= -vta -vh 180 -vv 180\nEXPOSURE=2\n")
    head, pixels = plain.read_bytes()[:-12], plain.read_bytes()[-12:]
    (tmp_path / "b.hdr").write_bytes(head.replace(b"\n", b"\r\n") + pixels)
    first, second = (picture.read(tmp_path / name) for name in ("a.hdr", "b.hdr"))
    np.testing.assert_array_equal(first.rgb, second.rgb)
    assert (first.view, first.exposure) == (second.view, second.exposure)
