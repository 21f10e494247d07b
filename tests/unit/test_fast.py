"""The list of long files names what is there."""

import pytest

from tests import ROOT, fast


@pytest.mark.parametrize("name", fast.LONG + fast.SHORT)
def test_named_files_are_there(name):
    assert (ROOT / "tests" / name).exists()


def test_a_file_in_a_long_folder_is_long_unless_it_is_named():
    assert fast.is_long("system/test_docs.py")
    assert not fast.is_long("system/test_plan_command.py")
    assert not fast.is_long("unit/sky/test_cie.py")


def test_this_test_is_fast(request):
    assert request.node.get_closest_marker("fast") is not None
