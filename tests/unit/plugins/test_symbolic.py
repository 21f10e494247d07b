"""Loops that are rewritten at their first call."""

import importlib
import os
import sys

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.symbolic import rewriting_later, symbolic

from drcmitsuba.runtime import backend

pytestmark = pytest.mark.usefixtures("variant")


def halvings(x, least=1.0):
    """Number of times that each x can be halved until it is below a number."""
    x, count = mi.Float(x), mi.UInt32(0)
    while x >= least:
        x /= 2
        count += 1
    return count


halvings_symbolic = symbolic(halvings)


class Counter:
    def __init__(self, least):
        self.least = least

    @symbolic
    def count(self, x):
        x, count = mi.Float(x), mi.UInt32(0)
        while x >= self.least:
            x /= 2
            count += 1
        return count


def test_loops_run_over_arrays_as_one_kernel():
    x = [0.5, 1.0, 7.0, 1e6]
    with pytest.raises(RuntimeError, match="implicit conversion"):  # a plain `while`
        halvings(mi.Float(x))
    expected = [halvings(mi.Float(v))[0] for v in x]
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        counted = halvings_symbolic(mi.Float(x))
        dr.eval(counted)
        kernels = [k for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT]
    assert len(kernels) == 1
    np.testing.assert_array_equal(counted, expected)
    np.testing.assert_array_equal(halvings_symbolic(mi.Float(x), least=4), [0, 0, 1, 18])
    np.testing.assert_array_equal(Counter(4).count(mi.Float(x)), [0, 0, 1, 18])
    words = "Number of times that each x can be halved until it is below a number."
    assert halvings_symbolic.__doc__ == words


def test_what_cannot_be_rewritten_fails_at_the_call():
    @symbolic
    def broken(x):
        while x > 0:
            return x
        return None

    with pytest.raises(SyntaxError, match="return"):
        broken(mi.Float([1, 2]))


def test_a_module_that_has_changed_since_its_import_is_not_rewritten(tmp_path, monkeypatch):
    file = tmp_path / "older_loops.py"
    text = "from drcmitsuba_plugins.symbolic import symbolic\n@symbolic\ndef {}(x):\n    return x\n"
    file.write_text(text.format("same") + text.format("other"))
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("older_loops")
    assert module.same(1) == 1
    os.utime(file, (0, 0))
    assert module.same(2) == 2
    with pytest.raises(RuntimeError, match=r"older_loops\.py has changed since it was imported"):
        module.other(1)


def test_decorators_with_options_are_drjits_own():
    with rewriting_later():
        late, early = dr.syntax(plain), dr.syntax(recursive=True)(plain)
    assert late.__wrapped__ is plain
    assert not hasattr(early, "__wrapped__")


def plain(x):
    return x


def test_mitsubas_integrators_are_rewritten_when_they_are_called():
    prb = sys.modules["mitsuba.python.ad.integrators.prb"]
    assert prb.PRBIntegrator.sample.__wrapped__.__name__ == "sample"
    scene = mi.load_dict(mi.cornell_box())
    image = mi.render(scene, integrator=mi.load_dict({"type": "prb"}), spp=1)
    assert np.isfinite(image.numpy()).all()
    assert image.numpy().max() > 0


def test_a_variant_that_cannot_be_set_leaves_drjits_own_decorator():
    own = dr.syntax
    with pytest.raises(ValueError, match="no such"), rewriting_later():
        raise ValueError("no such variant")
    assert dr.syntax is own
    assert backend.select() == mi.variant()
    assert dr.syntax is own
