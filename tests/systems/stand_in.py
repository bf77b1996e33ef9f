"""A tracker that says which frame its result is of, and when it took it."""

import numpy as np
from pydrake.systems.framework import LeafSystem

from mffdrake.systems.timing import Timing


class StandIn(LeafSystem):
    """A recognizer's ports without images: frame k's pose is (k, k, k, ...), its fitness 1/(1 + k).

    ``taken`` has each frame's time and the prediction that it read.
    """

    def __init__(self, *, num_hypotheses=2, timing=None):
        super().__init__()
        self.timing = Timing() if timing is None else timing
        self.taken = []
        self._predicted = self.DeclareVectorInputPort("predicted_population", 6 * num_hypotheses)
        self._num_frames = self.DeclareDiscreteState(1)
        outputs = {
            "frame_time": np.full(1, np.nan),
            "pose": np.full(6, -1.0),
            "fitness": np.zeros(1),
            "pose_covariance": np.full(36, np.nan),
            "population": np.tile([0.0, 0.155, 0.8, 0.0, 0.0, 0.0], num_hypotheses),
        }
        self._states = {name: self.DeclareDiscreteState(v) for name, v in outputs.items()}
        for name, index in self._states.items():
            self.DeclareStateOutputPort(name, index)
        self.DeclarePeriodicDiscreteUpdateEvent(
            self.timing.control_period, 0.0, self._update_on_vision_tick
        )

    def _update_on_vision_tick(self, context, discrete_state):
        time = context.get_time()
        if not self.timing.IsVisionTick(time):
            return
        predicted = self._predicted.Eval(context) if self._predicted.HasValue(context) else None
        self.taken.append((time, predicted))
        (frame,) = context.get_discrete_state(self._num_frames).value()
        discrete_state.set_value(self._num_frames, [frame + 1])
        for name, value in (
            ("frame_time", [time]),
            ("pose", np.full(6, frame)),
            ("fitness", [1.0 / (1.0 + frame)]),
            ("pose_covariance", frame + np.arange(36.0)),
        ):
            discrete_state.set_value(self._states[name], value)
