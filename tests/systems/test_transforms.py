"""Rotations of YAML files are Drake's, to the last bit."""

import numpy as np
import pytest
from pydrake.common.schema import Rotation

from mffdrake.recognition.parameters.rotations import AngleAxisDeg, RpyDeg


@pytest.mark.parametrize("scale", [1e-3, 1.0, 360.0])
def test_rotations_are_drake_s_to_the_last_bit(scale):
    rng = np.random.default_rng(0)
    for _ in range(500):
        angles, axis = (scale * rng.uniform(-1.0, 1.0, 3)).tolist(), rng.normal(size=3).tolist()
        for own, theirs in (
            (RpyDeg(deg=angles), Rotation.Rpy(deg=angles)),
            (
                AngleAxisDeg(angle_deg=angles[0], axis=axis),
                Rotation.AngleAxis(angle_deg=angles[0], axis=axis),
            ),
        ):
            expected = Rotation(value=theirs).GetDeterministicValue().matrix()
            np.testing.assert_array_equal(own.CalcMatrix(), expected)
