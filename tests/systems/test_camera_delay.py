"""A delayed vector is the vector of some control periods ago."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from mffdrake.systems.cameras.camera_delay import AddDelay
from mffdrake.systems.timing import Timing

TIMING = Timing()
RAMP = PiecewisePolynomial.FirstOrderHold([0.0, 10.0], [[5.0, 25.0], [-1.0, 0.0]])


@pytest.mark.parametrize("latency", [0.001, 0.033, 0.040])
def test_it_is_the_signal_of_a_latency_ago_and_before_that_the_initial_value(latency):
    builder = DiagramBuilder()
    source = builder.AddSystem(TrajectorySource(RAMP))
    initial = [7.0, 8.0]
    port = AddDelay(builder, source.get_output_port(), latency=latency, initial_value=initial)
    builder.ExportOutput(port, "delayed")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    for tick in range(1, 100):
        simulator.AdvanceTo(TIMING.TimeOfTick(tick))
        # The tick's own event is still to come, as it is for the recognizer that reads it then.
        delayed = diagram.GetOutputPort("delayed").Eval(simulator.get_context())
        before = tick - TIMING.Tick(latency)
        expected = initial if before < 0 else RAMP.value(TIMING.TimeOfTick(before)).ravel()
        np.testing.assert_allclose(delayed, expected, atol=1e-12)


def test_without_latency_it_is_the_signal_itself():
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([1.0]))
    port = AddDelay(builder, source.get_output_port(), latency=0.0, initial_value=[3.0])
    assert port.get_system() is source
    assert len(builder.GetSystems()) == 1


@pytest.mark.parametrize("latency", [-0.001, 0.0005, np.inf, np.nan])
def test_a_wrong_latency_is_named(latency):
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([1.0]))
    with pytest.raises(ValueError, match="latency must be at least 0 and a whole multiple"):
        AddDelay(builder, source.get_output_port(), latency=latency, initial_value=[3.0])
