"""Light that openings send back: followed on paths, and solved on cells."""

import numpy as np
import pytest

from drcmitsuba.runtime import backend
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.transport import elements
from drcmitsuba.transport.elements.marked_light import MarkedLight
from drcmitsuba.transport.elements.solved_paths import SolvedReturn
from tests import ROOT
from tests.unit.transport.exact_scenes import CLOTH, GLASS, OPPOSITE, SUNS
from tests.unit.transport.test_light_by_element import case

FILM = {"type": "bsdf", "file": str(ROOT / "scenes" / "films" / "prism.xml")}
SUN = 2e3
"""Luminance of the suns beside that of the sky, 1."""


def strip(material):
    return {"strips": [{"bottom": 0.9, "top": 2.7, "material": material}]}


def two_sides():
    """A film to the south, behind which a cloth may close, a house opposite, glass to the west."""
    return case(
        facade={"south": strip("film"), "west": strip("glass")},
        materials={"film": FILM, "glass": GLASS, "cloth": CLOTH},
        groups={"south": {"panes": ["film"], "states": ["cloth"]}},
        furniture=[OPPOSITE],
    )


def sent_back(solved):
    """Light of all sensors that the film, and then the cloth, sends back, (fill, replicate)."""
    one = two_sides()
    finer = {"paths": 8192, "cell_paths": 128, "film_sky_samples": 16, "seed": int(solved)}
    accuracy = one.accuracy.model_copy(update=finer)
    effects = EnabledEffects(solved_cells=solved)
    light = elements.compute(one, PaneGroups.of(one), SUNS, accuracy, effects)
    assert isinstance(light.returned[0], SolvedReturn if solved else MarkedLight)
    L = np.where(np.arange(len(light.labels)) < light.sky_bins, 1, SUN)
    without = np.array([0] * 2 + [1] * (len(light.elements) - 2), np.float32)
    rows = []
    for fill in (0, 1):
        shares = without.copy()
        shares[fill] = 1
        some, E = [(1, light.besides), *zip(shares, light.elements, strict=True)], []
        for k, back in enumerate(light.returned):
            D = sum(w * (L[each.bins] @ each.blocks[k]) for w, each in some)
            E.append((back.weighed(shares) - back.weighed(without)) @ D)
        rows.append(np.sum(E, axis=1))
    return np.array(rows)


@pytest.mark.slow
def test_films_send_light_back_by_their_lobes_on_cells_and_on_paths():
    """And as if it came evenly, what reaches them straight by the other window."""
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    E = np.array([sent_back(solved) for solved in (False, True)])
    mean, error = E.mean(axis=-1), E.std(axis=-1, ddof=1) / np.sqrt(E.shape[-1])
    assert (np.hypot(*error) < 0.01 * mean[0]).all()
    assert (abs(mean[1] - mean[0]) < 4 * np.hypot(*error)).all()
