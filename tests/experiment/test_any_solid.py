"""Solids of all kinds are found and tracked in simulation."""

import numpy as np
import pytest

from mffdrake.experiment.scenario import Change, Scenario
from mffdrake.experiment.simulation import Simulate

NAMES = ("wedge", "hexagonal_prism", "l_block", "notched_box", "hammer", "mug")


@pytest.mark.parametrize("name", NAMES)
def test_it_is_found_anywhere_and_tracked_on_the_paper_s_path(name):
    scenario = Change(
        Scenario(),
        {
            "renderer": "flat", "method": "mff", "duration": 1.2, "seed": 11,
            "hand_path.omega": 0.314, "recognizer.refinement": "borders",
            "target.model": f"package://mffdrake/{name}.sdf",
        },
    )  # fmt: skip
    result = Simulate(scenario)
    distance = np.linalg.norm(result.true_pose[:, :3] - result.recognized_pose[:, :3], axis=1)
    assert (distance[10:] < 2e-3).all() and np.median(distance[10:]) < 5e-4
    assert result.is_tracking[10:].mean() > 0.8
    assert result.fitness[10:].min() > 0.9
