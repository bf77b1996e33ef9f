"""A pose estimator as a Drake system, frame by frame: the 1-step GA, or any other tracker."""

from __future__ import annotations

import math
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from mffdrake.recognition import Generation, OneStepGaTracker, Tracker, TrackingState
from mffdrake.recognition.fitness.matching import NO_GAINS
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.poses.pose_filter import NUM_NUMBERS, PoseFilter
from mffdrake.systems.callbacks import WeakCallback
from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.estimates import (
    CheckGeneration,
    CheckTracker,
    CovarianceFromVector,
    CovarianceToVector,
)

__all__ = ["OneStepGaRecognizer", "PoseRecognizer"]

TrackerT = TypeVar("TrackerT", bound=Tracker)


class PoseRecognizer(LeafSystem, Generic[TrackerT]):
    """Recognizes the target's pose in the images of a rig, one step of a tracker a frame.

    .. pydrake_system::

        name: PoseRecognizer
        input_ports:
        - color_image_right
        - color_image_left
        - predicted_population (optional)
        - X_WC (optional)
        output_ports:
        - pose
        - X_CM
        - fitness
        - population
        - population_fitness
        - frame_time
        - pose_covariance
        - state
        - confidence
        - is_tracking
        - X_WM

    At every frame (each ``timing.vision_period``, from time 0) it reads the images and takes one
    step of its tracker. Its hypotheses come from ``predicted_population`` where that is connected
    (`MffPredictor` computes it from ``population``), and otherwise from its own last frame: that is
    tracking without motion feedforward. A forced discrete update takes a frame at once, whatever
    the time.

    All of its state is numeric and discrete: the number of frames so far, the last one's time,
    poses, fitness, covariance, white balance, what is thought of the pose and what is known of the
    target's own motion; and the cameras' pose. Outputs depend on the state alone, so the loop
    through a predictor is none.

    Ports:
        color_image_right, color_image_left: ImageRgba8U of these cameras. They are those of
            `CameraRig.stereo`; in general there is one port for each camera of the tracker's rig.
        predicted_population: The N hypotheses carried to the present frame, shape (6 N,).
        X_WC: The rig's pose in the world at the present frame's exposure, as a RigidTransform;
            `MffPredictor` knows it.
        pose: Recognized pose vector ``(r [m], eps)`` in frame C, shape (6,). Before the first frame
            it is the tracker's ``initial_pose``.
        X_CM: The same as a RigidTransform.
        fitness: Its fitness, 0 to 1; before the first frame 0, and in frames in which the tracker
            found nothing.
        population: All hypotheses after the last frame, best first, shape (6 N,).
        population_fitness: Their fitness, shape (N,).
        frame_time: Time of the last frame [s]; before the first one NaN.
        pose_covariance: Covariance of the error of ``pose``, 6 x 6 row by row, shape (36,). NaN
            where the tracker does not tell it: so it is while it searches, has lost the target or
            finds it ambiguous. Where the pose is predicted, it is the prediction's.
        state: What the tracker says of the pose, a number of `TrackingState`, shape (1,).
        confidence: Probability that the pose is right to 5 mm and 1 deg, shape (1,); NaN where the
            tracker does not tell it.
        is_tracking: 1 where the pose is right with enough confidence, else 0, shape (1,).
        X_WM: The recognized pose in the world as a RigidTransform, where ``X_WC`` is connected; an
            error before the first frame.

    Args:
        tracker: The pose estimator, with all of its parameters; see `Tracker`.
        timing: Control and vision periods: those of the predictor, where there is one.

    Raises:
        ValueError: When the tracker's ``num_hypotheses`` or ``initial_pose`` is none; at a frame,
            when it returns arrays of another shape than these tell.
        RuntimeError: At a frame, when an image port is not connected.

    Example:
        >>> from mffdrake.recognition import CameraRig
        >>> class Nowhere:
        ...     rig, num_hypotheses, initial_pose = CameraRig.stereo(), 1, np.zeros(6)
        ...     def start_population(self, images, *, frame):
        ...         return Generation(np.zeros((1, 6)), np.zeros(1))
        ...     def track(self, generation, images, *, frame):
        ...         return Generation(generation.poses, np.zeros(1))
        >>> recognizer = PoseRecognizer(tracker=Nowhere())
        >>> recognizer.GetInputPort("predicted_population").size()
        6
    """

    def __init__(self, *, tracker: TrackerT, timing: Timing | None = None) -> None:
        super().__init__()
        CheckTracker(tracker)
        self._tracker = tracker
        self._timing = Timing() if timing is None else timing
        n = tracker.num_hypotheses

        image = AbstractValue.Make(ImageRgba8U())
        self._images = [
            self.DeclareAbstractInputPort(f"color_image_{name}", image)
            for name in tracker.rig.names
        ]
        self._predicted = self.DeclareVectorInputPort("predicted_population", 6 * n)
        self._camera_pose = self.DeclareAbstractInputPort(
            "X_WC", AbstractValue.Make(RigidTransform())
        )

        self._num_frames = self.DeclareDiscreteState(1)
        self._frame_time = self.DeclareDiscreteState([math.nan])
        self._poses = self.DeclareDiscreteState(np.tile(tracker.initial_pose, n))
        self._fitness = self.DeclareDiscreteState(n)
        self._covariance = self.DeclareDiscreteState(np.full(36, math.nan))
        self._gains = self.DeclareDiscreteState(NO_GAINS)
        self._state = self.DeclareDiscreteState([TrackingState.SEARCHING])
        self._confidence = self.DeclareDiscreteState([math.nan])
        self._is_tracking = self.DeclareDiscreteState(1)
        self._unseen = self.DeclareDiscreteState(1)
        self._image_hashes = self.DeclareDiscreteState(np.full(len(tracker.rig.cameras), math.nan))
        self._motion = self.DeclareDiscreteState(np.full(NUM_NUMBERS, math.nan))
        self._exposed_pose = self.DeclareDiscreteState(np.full(12, math.nan))

        # With the state as their only prerequisite, outputs have no feedthrough from the inputs.
        from_poses = {self.discrete_state_ticket(self._poses)}
        from_fitness = {self.discrete_state_ticket(self._fitness)}
        self.DeclareVectorOutputPort("pose", 6, WeakCallback(self._CalcPose), from_poses)
        self.DeclareAbstractOutputPort(
            "X_CM",
            lambda: AbstractValue.Make(RigidTransform()),
            WeakCallback(self._CalcTransform),
            from_poses,
        )
        self.DeclareVectorOutputPort("fitness", 1, WeakCallback(self._CalcFitness), from_fitness)
        for name, state in (
            ("population", self._poses),
            ("population_fitness", self._fitness),
            ("frame_time", self._frame_time),
            ("pose_covariance", self._covariance),
            ("state", self._state),
            ("confidence", self._confidence),
            ("is_tracking", self._is_tracking),
        ):
            self.DeclareStateOutputPort(name, state)
        self.DeclareAbstractOutputPort(
            "X_WM",
            lambda: AbstractValue.Make(RigidTransform()),
            WeakCallback(self._CalcWorldTransform),
            from_poses | {self.discrete_state_ticket(self._exposed_pose)},
        )

        self.DeclarePeriodicDiscreteUpdateEvent(
            self._timing.event_period, 0.0, self._UpdateOnVisionTick
        )
        self.DeclareForcedDiscreteUpdateEvent(self._TakeFrame)

    @property
    def tracker(self) -> TrackerT:
        """The pose estimator, with all of its parameters."""
        return self._tracker

    @property
    def timing(self) -> Timing:
        """Control and vision periods."""
        return self._timing

    @property
    def num_hypotheses(self) -> int:
        """Number N of hypotheses in the population."""
        return self._tracker.num_hypotheses

    def _UpdateOnVisionTick(self, context: Context, discrete_state: DiscreteValues) -> None:
        if self._timing.IsVisionTick(context.get_time()):
            self._TakeFrame(context, discrete_state)

    def _TakeFrame(self, context: Context, discrete_state: DiscreteValues) -> None:
        images = [self._Image(context, port) for port in self._images]
        frame = int(context.get_discrete_state(self._num_frames).value()[0])
        if frame == 0:
            generation = self._tracker.start_population(images, frame=frame)
            CheckGeneration(generation, self._tracker, "start_population")
        else:
            generation = self._tracker.track(self._LastGeneration(context), images, frame=frame)
            CheckGeneration(generation, self._tracker, "track")
        g = generation
        for index, value in (
            (self._num_frames, [frame + 1]),
            (self._frame_time, [context.get_time()]),
            (self._poses, g.poses.reshape(-1)),
            (self._fitness, g.fitness),
            (self._covariance, CovarianceToVector(g.covariance)),
            (self._gains, g.gains),
            (self._state, [g.state]),
            (self._confidence, [g.confidence]),
            (self._is_tracking, [float(g.is_tracking)]),
            (self._unseen, [g.unseen]),
        ):
            discrete_state.set_value(index, value)
        numbers = np.full(NUM_NUMBERS, math.nan)
        if g.motion is not None:
            numbers = g.motion.numbers(g.best)
        discrete_state.set_value(self._motion, numbers)
        if g.image_hashes:
            discrete_state.set_value(self._image_hashes, g.image_hashes)
        if self._camera_pose.HasValue(context):
            X_WC = self._camera_pose.Eval(context)
            discrete_state.set_value(self._exposed_pose, X_WC.GetAsMatrix34().reshape(-1))

    def _LastGeneration(self, context: Context) -> Generation:
        """The last frame's result, carried to the present one.

        All copies: a tracker may write on what it is given, but not on the Context.
        """
        kept = context.get_discrete_state()

        def numbers(index) -> NDArray[np.float64]:
            return kept.value(index).copy()

        poses, covariance = self._CarriedPoses(context), numbers(self._covariance)
        red, green, blue = numbers(self._gains).tolist()
        state, confidence, is_tracking, unseen = (
            numbers(index).item()
            for index in (self._state, self._confidence, self._is_tracking, self._unseen)
        )
        motion = numbers(self._motion)
        return Generation(
            poses,
            numbers(self._fitness),
            CovarianceFromVector(covariance),
            (red, green, blue),
            TrackingState(int(state)),
            confidence,
            is_tracking > 0.0,
            int(unseen),
            None if math.isnan(motion[0]) else PoseFilter.of_numbers(poses[0], motion),
            tuple(numbers(self._image_hashes).tolist()),
        )

    def _CarriedPoses(self, context: Context) -> NDArray[np.float64]:
        """The last frame's hypotheses: predicted where a predictor is connected."""
        if self._predicted.HasValue(context):
            return self._predicted.Eval(context).reshape(-1, 6).copy()
        return context.get_discrete_state(self._poses).value().reshape(-1, 6).copy()

    def _Image(self, context: Context, port) -> NDArray[np.uint8]:
        """A port's pixels: a view, valid until the next rendering."""
        if not port.HasValue(context):
            raise RuntimeError(
                f"{self.get_name() or type(self).__name__}: input port '{port.get_name()}' is not "
                "connected; connect it to an RgbdSensor's color_image or fix its value"
            )
        return port.Eval(context).data

    def _CalcPose(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._poses).value()[:6])

    def _CalcFitness(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._fitness).value()[:1])

    def _CalcTransform(self, context: Context, output: AbstractValue) -> None:
        R, p = transform_from_pose(context.get_discrete_state(self._poses).value()[:6])
        output.set_value(RigidTransform(RotationMatrix(R), p))

    def _CalcWorldTransform(self, context: Context, output: AbstractValue) -> None:
        X_WC = context.get_discrete_state(self._exposed_pose).value()
        if math.isnan(X_WC[0]):
            raise RuntimeError(
                f"{self.get_name() or type(self).__name__}: X_WM is known from the first frame on "
                "at which input port 'X_WC' was connected; connect it to MffPredictor's X_WC"
            )
        R, p = transform_from_pose(context.get_discrete_state(self._poses).value()[:6])
        output.set_value(RigidTransform(X_WC.reshape(3, 4)) @ RigidTransform(RotationMatrix(R), p))


class OneStepGaRecognizer(PoseRecognizer[OneStepGaTracker]):
    """The `PoseRecognizer` of the 1-step GA: one generation on every frame.

    .. pydrake_system::

        name: OneStepGaRecognizer
        input_ports:
        - color_image_right
        - color_image_left
        - predicted_population (optional)
        - X_WC (optional)
        output_ports:
        - pose
        - X_CM
        - fitness
        - population
        - population_fitness
        - frame_time
        - pose_covariance
        - state
        - confidence
        - is_tracking
        - X_WM

    Without ``predicted_population`` it is the plain 1-step GA. Before the first frame ``pose`` is
    the center of the search range, and ``pose_covariance`` is NaN where the pose is not refined, as
    without a refiner in the tracker.

    Args:
        tracker: The algorithm, with all of its parameters.
        timing: Control and vision periods: those of the predictor, where there is one.

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, Matcher, SearchModel, SolidModel
        >>> from mffdrake.recognition import CameraRig
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> matcher = Matcher(SearchModel(box), CameraRig.stereo())
        >>> recognizer = OneStepGaRecognizer(tracker=OneStepGaTracker(matcher=matcher))
        >>> context = recognizer.CreateDefaultContext()
        >>> for side in ("right", "left"):
        ...     _ = recognizer.GetInputPort(f"color_image_{side}").FixValue(
        ...         context, ImageRgba8U(640, 480))
        >>> recognizer.CalcForcedDiscreteVariableUpdate(
        ...     context, context.get_mutable_discrete_state())
        >>> recognizer.GetOutputPort("frame_time").Eval(context)
        array([0.])
    """
