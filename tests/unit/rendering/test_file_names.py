"""Names of files that come from the names of views."""

import itertools

import pytest

from drcmitsuba.rendering.rendering import LONGEST, file_name


def test_plain_names_and_spaces_stay():
    assert [file_name(view) for view in ("desk", "Sitz am Fenster-2", "机_1")] == [
        "desk", "Sitz_am_Fenster-2", "机_1",
    ]  # fmt: skip


@pytest.mark.parametrize("views", [
    ("a/b", "a b", "a.b", "a_b", "a  b", "a\\b"), ("/", ".", ""), ("x" * 100, "x" * 101),
])  # fmt: skip
def test_views_share_no_file_unless_they_differ_by_underscores(views):
    names = [file_name(view) for view in views]
    for one, other in itertools.combinations(names, 2):
        assert one != other or one == other == "a_b"
    assert all(0 < len(name) <= LONGEST and name.isprintable() for name in names)
    assert not any(set(name) & set('/\\.:*?"<>| ') for name in names)
