"""The variant of Mitsuba that tests of eyes run on."""

import pytest

from drcmitsuba.runtime import backend


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
