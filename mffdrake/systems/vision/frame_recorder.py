"""Records what a recognizer found, frame by frame, with other signals as they were then."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
    OutputPort,
    ValueProducer,
)

from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.exposures import Exposures
from mffdrake.systems.vision.recognizer import PoseRecognizer

__all__ = ["FrameRecorder"]

Array = NDArray[np.float64]

_RESULTS = {"frame_time": 1, "pose": 6, "fitness": 1, "pose_covariance": 36}
"""The recognizer's ports and their sizes."""


class FrameRecorder(LeafSystem):
    """Records one row for each frame: the recognizer's result and other signals at that frame.

    .. pydrake_system::

        name: FrameRecorder
        input_ports:
        - frame_time
        - pose
        - fitness
        - pose_covariance
        - state

    A recognizer's outputs are those of its last frame until the next one, so a plain log pairs them
    with what has moved on since. This one reads the signals in the very event in which the
    recognizer reads its images, holds them in discrete state, and adds the row once the frame's
    result is there, in the same simulation step.

    The rows are kept in the context, as by Drake's VectorLogSink: every context has its own, which
    only grow, and a copied context has copies.

    Ports:
        frame_time, pose, fitness, pose_covariance: The recognizer's outputs of these names.
        state: A signal, as in the example below; in general there is one port for each signal.

    Args:
        signals: Sizes of the signals by name.
        latency: How long before a frame's time the signals are wanted [s], a whole multiple of the
            control period: with that of late cameras, the signals are those that the images show.
            They are NaN where that was before the simulation.
        timing: Control and vision periods: those of the recognizer.

    Raises:
        ValueError: When a signal is named like a result or the latency is no such multiple.
        RuntimeError: In a simulation, when the recognizer took a frame at another time.

    Example:
        >>> recorder = FrameRecorder(signals={"state": 2})
        >>> context = recorder.CreateDefaultContext()
        >>> for name, value in (("frame_time", [0]), ("pose", [0] * 6), ("fitness", [0.9]),
        ...                     ("pose_covariance", [0] * 36), ("state", [7, 8])):
        ...     _ = recorder.GetInputPort(name).FixValue(context, value)
        >>> recorder.CalcForcedDiscreteVariableUpdate(
        ...     context, context.get_mutable_discrete_state())
        >>> recorder.ForcedPublish(context)
        >>> frames = recorder.FindFrames(context)
        >>> frames["fitness"], frames["state"]
        (array([0.9]), array([[7., 8.]]))
    """

    def __init__(
        self,
        *,
        signals: Mapping[str, int],
        latency: float = 0.0,
        timing: Timing | None = None,
    ) -> None:
        super().__init__()
        for name in signals:
            if name in _RESULTS:
                raise ValueError(
                    f"FrameRecorder: a signal must have another name than the recognizer's own "
                    f"{', '.join(_RESULTS)}, not {name!r}; rename it"
                )
        self._timing = Timing() if timing is None else timing
        self._exposures = Exposures(self._timing, latency)
        self._sizes = {**_RESULTS, **signals}
        self._results = [self.DeclareVectorInputPort(name, n) for name, n in _RESULTS.items()]
        self._signals = [self.DeclareVectorInputPort(name, n) for name, n in signals.items()]

        # Rows of a time and the signals then: at the last exposures, and those of the last frame.
        width = 1 + sum(signals.values())
        self._samples = self.DeclareDiscreteState(
            np.full(self._exposures.num_samples * width, math.nan)
        )
        self._held = self.DeclareDiscreteState(np.full(width, math.nan))
        # Written by publish events, which must not change the state: Drake's own logs do the same.
        self._rows = self.DeclareCacheEntry(
            "rows",
            ValueProducer(allocate=lambda: AbstractValue.Make([]), calc=ValueProducer.NoopCalc),
            {self.nothing_ticket()},
        )

        self.DeclarePeriodicDiscreteUpdateEvent(
            self._timing.control_period, 0.0, self._UpdateOnTick
        )
        self.DeclareForcedDiscreteUpdateEvent(self._Update)
        self.DeclarePerStepPublishEvent(self._Record)
        self.DeclareForcedPublishEvent(self._Record)

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        recognizer: PoseRecognizer[Any],
        signals: Mapping[str, OutputPort],
        *,
        latency: float = 0.0,
        name: str = "frame_recorder",
    ) -> FrameRecorder:
        """Adds a recorder of a recognizer and connects it.

        Args:
            builder: The builder of the diagram, to which the recognizer has been added.
            recognizer: The recognizer, with any tracker.
            signals: Vector ports of the same diagram by the names of what they are recorded as.
            latency: How long before a frame's time the signals are wanted [s]; see the class.
            name: The recorder's name.

        Returns:
            The recorder.

        Raises:
            ValueError: See the class.
        """
        recorder = FrameRecorder(
            signals={key: port.size() for key, port in signals.items()},
            latency=latency,
            timing=recognizer.timing,
        )
        builder.AddNamedSystem(name, recorder)
        ports = {key: recognizer.GetOutputPort(key) for key in _RESULTS}
        for key, port in {**ports, **signals}.items():
            builder.Connect(port, recorder.GetInputPort(key))
        return recorder

    def FindFrames(self, root_context: Context) -> dict[str, Array]:
        """What has been recorded in a context.

        Args:
            root_context: The context of the whole diagram, as `Simulator.get_context` returns it.

        Returns:
            For K frames, ``frame_time`` [s] of shape (K,), ``pose``, vectors ``(r [m], eps)`` in
            frame C, of shape (K, 6), ``fitness`` of shape (K,), ``pose_covariance`` of shape
            (K, 6, 6) and every signal by its name, of shape (K, n).
        """
        rows = self._Rows(self.GetMyContextFromRoot(root_context))
        table = np.reshape(rows, (len(rows), sum(self._sizes.values())))
        columns = np.split(table, np.cumsum(list(self._sizes.values()))[:-1], axis=1)
        frames = dict(zip(self._sizes, columns, strict=True))
        for name, shape in (("frame_time", ()), ("fitness", ()), ("pose_covariance", (6, 6))):
            frames[name] = frames[name].reshape(len(rows), *shape)
        return frames

    def _Rows(self, context: Context) -> list[Array]:
        rows: list[Array] = self._rows.get_mutable_cache_entry_value(
            context
        ).GetMutableValueOrThrow()
        return rows

    def _UpdateOnTick(self, context: Context, discrete_state: DiscreteValues) -> None:
        time = context.get_time()
        if self._timing.IsVisionTick(time):
            self._Hold(context, discrete_state)
        if self._exposures.IsExposure(time):
            self._Sample(context, discrete_state)

    def _Update(self, context: Context, discrete_state: DiscreteValues) -> None:
        self._Hold(context, discrete_state)
        self._Sample(context, discrete_state)

    def _Hold(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Keeps the signals of this frame."""
        now = self._Now(context)
        rows = context.get_discrete_state(self._samples).value().reshape(-1, 1 + len(now))
        _, present = self._exposures.Rows(context.get_time(), rows=rows, now=now)
        discrete_state.set_value(self._held, np.append(context.get_time(), present[1:]))

    def _Sample(self, context: Context, discrete_state: DiscreteValues) -> None:
        newest = np.append(context.get_time(), self._Now(context))
        older = context.get_discrete_state(self._samples).value()[: -len(newest)]
        discrete_state.set_value(self._samples, np.append(newest, older))

    def _Now(self, context: Context) -> Array:
        return np.concatenate([np.zeros(0), *(port.Eval(context) for port in self._signals)])

    def _Record(self, context: Context) -> None:
        """Adds a row when the recognizer has taken another frame."""
        (frame_time,) = self._results[0].Eval(context)
        rows = self._Rows(context)
        if math.isnan(frame_time) or (rows and rows[-1][0] == frame_time):
            return
        held_time, *signals = context.get_discrete_state(self._held).value()
        if not abs(held_time - frame_time) < 0.5 * self._timing.control_period:  # true for NaN
            raise RuntimeError(
                f"{self.get_name() or type(self).__name__}: the recognizer's last frame "
                f"('frame_time') was at {frame_time:.6g} s, but this system's at {held_time:.6g} s,"
                f" with a frame every {self._timing.vision_period:.6g} s; give both the same timing"
            )
        results = [port.Eval(context) for port in self._results]
        rows.append(np.concatenate([*results, signals]))
