"""A run of tests says what it skipped, and fails with a skip that nobody expects."""

import subprocess
import sys

import pytest

from tests import ROOT, SHARED, skips
from tests.fast import slowly

FILES = {
    "test_whole.py": 'from tests import skips\nskips.UNFIT_LLVM.skip("whole file")\n',
    "test_some.py": """
import pytest
from tests import skips

@pytest.mark.parametrize("version", [14, 15])
def test_of_an_old_compiler(version):
    skips.UNFIT_LLVM.skip(version)

def test_that_runs():
    pass

@pytest.mark.xfail
def test_that_is_known_to_fail():
    raise ValueError
""",
}
LINE = "    3 no unfit LLVM (few machines have an LLVM that is too old)"


@pytest.fixture
def run(tmp_path):
    """Run tests beside the declared skips: exit code and output."""
    (tmp_path / "pytest.ini").write_text("[pytest]\n")

    def run(more="", processes=0):
        for name, text in FILES.items():
            (tmp_path / name).write_text(text)
        (tmp_path / "test_more.py").write_text(more)
        options = ["-p", "tests.skips", "-p", "no:cacheprovider", "-n", str(processes)]
        command = [sys.executable, "-m", "pytest", *options, str(tmp_path)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        return done.returncode, done.stdout.splitlines()

    return run


@pytest.mark.parametrize("processes", slowly([0, 2], 2))
def test_expected_skips_are_counted_and_others_fail_the_run(run, processes):
    code, lines = run(processes=processes)
    assert LINE in lines
    assert code == 0
    other = 'import pytest\ndef test_other():\n    pytest.skip("no mood")\n'
    code, lines = run(other, processes)
    assert LINE in lines
    assert "    1 no mood (not expected: fails the run)" in lines
    assert code == pytest.ExitCode.TESTS_FAILED


def test_what_the_machine_has_is_no_reason():
    has = [lack for lack in skips.LACKS if not lack.is_so()]
    assert has
    assert not any(map(skips.lack_of, (lack.words for lack in has)))
    assert skips.lack_of(skips.UNFIT_LLVM.reason(14)) is skips.UNFIT_LLVM
    assert skips.lack_of("got empty parameter set for (variant)") is None


def test_data_that_are_missing_in_their_folder_are_no_reason(monkeypatch, tmp_path):
    monkeypatch.setattr(skips, "SHARED", tmp_path)
    with pytest.raises(pytest.skip.Exception) as skipped:
        skips.data(tmp_path / "data" / "none.epw")
    assert skipped.value.msg == "no shared data: data/none.epw"
    assert skips.lack_of(skipped.value.msg) is None
    monkeypatch.setattr(skips, "SHARED", tmp_path / "none")
    assert skips.lack_of(skipped.value.msg) is skips.DATA


def test_words_are_told_apart():
    words = [lack.words for lack in skips.LACKS]
    assert len(set(words)) == len(words)
    assert not any(":" in w for w in words)
    assert SHARED.name == "shared"
