"""Connects the motion feedforward with a recognizer."""

from __future__ import annotations

from typing import Any

from pydrake.systems.framework import DiagramBuilder, OutputPort

from mffdrake.systems.vision.predictor import MffPredictor
from mffdrake.systems.vision.recognizer import PoseRecognizer

__all__ = ["ConnectFeedforward"]


def ConnectFeedforward(
    builder: DiagramBuilder,
    *,
    recognizer: PoseRecognizer[Any],
    predictor: MffPredictor,
    estimated_state: OutputPort,
) -> None:
    """Closes the loop of a recognizer and a predictor, once it is sure that they fit.

    The hypotheses go from ``population`` through the predictor to ``predicted_population``;
    ``frame_time`` tells the predictor which frame they are of, and ``X_WC`` the recognizer where
    its camera was. A ``target_velocity`` is left to the caller.

    Args:
        builder: The builder of the diagram, to which both systems have been added.
        recognizer: The recognizer, with any tracker.
        predictor: The predictor.
        estimated_state: The arm's joint positions [rad] and velocities [rad/s].

    Raises:
        ValueError: When the two systems differ in their timing or their number of hypotheses.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, CameraRig, Matcher
        >>> from mffdrake.recognition import OneStepGaTracker, SearchModel, SolidModel
        >>> from mffdrake.systems.vision.recognizer import OneStepGaRecognizer
        >>> from mffdrake.systems.arms.pa10 import MakePa10Plant
        >>> from pydrake.systems.primitives import ConstantVectorSource
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> matcher = Matcher(SearchModel(box), CameraRig.stereo())
        >>> builder = DiagramBuilder()
        >>> recognizer = OneStepGaRecognizer(tracker=OneStepGaTracker(matcher=matcher))
        >>> predictor = MffPredictor(plant=MakePa10Plant(), timing=recognizer.timing)
        >>> arm = ConstantVectorSource([0.0] * 14)
        >>> for system in (recognizer, predictor, arm):
        ...     _ = builder.AddSystem(system)
        >>> ConnectFeedforward(builder, recognizer=recognizer, predictor=predictor,
        ...                    estimated_state=arm.get_output_port())
        >>> builder.IsConnectedOrExported(recognizer.GetInputPort("predicted_population"))
        True
    """
    for what, of_recognizer, of_predictor, remedy in (
        ("timing", recognizer.timing, predictor.timing, "timing=recognizer.timing"),
        (
            "number of hypotheses",
            recognizer.GetOutputPort("population").size() // 6,
            predictor.GetInputPort("population").size() // 6,
            "num_hypotheses=recognizer.num_hypotheses",
        ),
    ):
        if of_recognizer != of_predictor:
            raise ValueError(
                f"ConnectFeedforward: the recognizer's {what} is {of_recognizer}, but the "
                f"predictor's {of_predictor}; give both the same, as by MffPredictor({remedy})"
            )
    for name in ("population", "frame_time"):
        builder.Connect(recognizer.GetOutputPort(name), predictor.GetInputPort(name))
    builder.Connect(
        predictor.GetOutputPort("predicted_population"),
        recognizer.GetInputPort("predicted_population"),
    )
    if recognizer.HasInputPort("X_WC"):  # A system of one's own may do without.
        builder.Connect(predictor.GetOutputPort("X_WC"), recognizer.GetInputPort("X_WC"))
    builder.Connect(estimated_state, predictor.GetInputPort("estimated_state"))
