"""Keys differ with every content and with nothing else."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import pytest

from drcmitsuba import load_case, shipped_cases
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.scene import scene
from drcmitsuba.sky.daylight import daylight


@dataclass(frozen=True)
class Sample:
    values: np.ndarray
    name: str = "a"


class Kind(Enum):
    ONE = 1
    TWO = 2


DIFFERENT = [
    None, True, 1, 1.0, "1", b"".decode(), Kind.ONE, Kind.TWO, (1,), [1], (1, 1), ((1,), 1),
    {"a": 1}, {"a": 2}, {"b": 1}, np.zeros(2), np.zeros(2, np.float32), np.zeros((2, 1)),
    np.array([0.0, 1e-300]), np.array(["a"], object), Accuracy(), Accuracy(seed=1),
    Sample(np.zeros(2)), Sample(np.ones(2)), Sample(np.zeros(2), "b"), ("ab", "c"), ("a", "bc"),
]  # fmt: skip


def test_different_contents_have_different_keys():
    keys = [content_key(value) for value in DIFFERENT]
    assert len(set(keys)) == len(DIFFERENT)


def test_equal_contents_have_equal_keys_whatever_made_them():
    assert content_key({"a": 1, "b": 2}) == content_key({"b": 2, "a": 1})
    assert content_key(np.arange(6)[::2]) == content_key(np.array([0, 2, 4]))
    assert content_key(Sample(np.arange(3.0))) == content_key(Sample(np.array([0.0, 1, 2])))


def test_a_path_stands_for_the_bytes_of_its_file(tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_bytes(b"film")
    two.write_bytes(b"film")
    assert content_key(one) == content_key(two)
    two.write_bytes(b"other")
    assert content_key(one) != content_key(two)


def test_a_value_of_unknown_content_is_refused():
    with pytest.raises(TypeError, match="object"):
        content_key([object()])


@pytest.mark.parametrize("name", ["classroom/o3", "duct/duct", "lamella/lamella", "prism/prism"])
def test_every_kind_of_scene_has_a_key_and_states_differ(name):
    backend.select()
    assert name in shipped_cases()
    case = load_case(name)
    effects = plan(case, daylight(case)).scope
    keys = [content_key(scene.load(case, "open", -1, e).content) for e in (effects, effects)]
    assert keys[0] == keys[1]
    other = replace(effects, solved_cells=not effects.solved_cells)
    assert content_key(scene.load(case, "open", -1, other).content) != keys[0]
