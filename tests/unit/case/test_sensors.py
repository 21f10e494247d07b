"""Points in the case itself: each has three or six numbers."""

import pytest

from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime.errors import InputError


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ("[[1, 1, 1], [1, 2]]", r"points\.1: \[1, 2\]; give x, y, z, or x, y, z, dx, dy, dz"),
        ("[[1, 1, 1, 0, 0, 0]]", r"points\.0: \[1, 1, 1, 0, 0, 0\]; give"),
        ('[[1, 1, "a"]]', r"points\.0"),
        ("[[1, 1, inf]]", r"points\.0"),
        ("[[1, 1, 1, 1]]", r"points\.0"),
        ("[1, 1, 1]", r"points\.0"),
        ("[]", "points"),
    ],
)
def test_what_is_no_point_is_refused_by_its_number(tmp_path, points, message):
    file = tmp_path / "case.toml"
    file.write_text(f"[room]\nsize = [4.0, 5.0, 3.0]\n[sensors]\npoints = {points}\n")
    with pytest.raises(InputError, match=message):
        load_case(file)
