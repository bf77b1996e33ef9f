"""What the recognizer system needs of a pose estimator, whatever is inside."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.camera.cameras import CameraRig
from mffdrake.recognition.genetic.generation import Generation

Array = NDArray[np.float64]
Image = NDArray[np.uint8]


class Tracker(Protocol):
    """A pose estimator that works frame by frame: `OneStepGaTracker`, or one of your own.

    It holds parameters only. All that it carries from frame to frame is the `Generation`, which the
    caller keeps (and carries to the next frame with the cameras' motion): N hypotheses with their
    fitness, the best one first, the covariance of that one, and a white balance. So the same
    arguments must always give the same result, and a tracker may serve several recognizers.

    An estimator that knows one pose at a time has one hypothesis.

    Attributes:
        rig: The cameras whose images it reads.
        num_hypotheses: Number N of hypotheses in every generation, at least 1.
        initial_pose: What is recognized before the first frame: a pose vector ``(r [m], eps)`` in
            the rig's frame C, shape (6,).

    Example:
        >>> from mffdrake.recognition import BLUE, GREEN, RED, Matcher, OneStepGaTracker
        >>> from mffdrake.recognition import SearchModel, SolidModel
        >>> box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
        >>> matcher = Matcher(SearchModel(box), CameraRig.stereo())
        >>> tracker: Tracker = OneStepGaTracker(matcher=matcher)
        >>> tracker.rig.names, tracker.num_hypotheses, tracker.initial_pose.shape
        (('right', 'left'), 60, (6,))
    """

    @property
    def rig(self) -> CameraRig:
        """The cameras whose images it reads."""
        ...

    @property
    def num_hypotheses(self) -> int:
        """Number N of hypotheses in every generation, at least 1."""
        ...

    @property
    def initial_pose(self) -> Array:
        """The pose vector before the first frame, shape (6,)."""
        ...

    def start_population(self, images: Sequence[Image], *, frame: int) -> Generation:
        """Takes the first frame.

        Args:
            images: One a camera, in the rig's order, RGB or RGBA, uint8, shape
                (height, width, 3 or 4). They are views: what is to be kept must be copied.
            frame: Number of the frame.

        Returns:
            N hypotheses, see `track`.
        """
        ...

    def track(self, generation: Generation, images: Sequence[Image], *, frame: int) -> Generation:
        """Takes the next frame.

        Args:
            generation: The last frame's result, its poses carried to this frame or, without motion
                feedforward, as they were; fitness, covariance and gains as they were.
            images: As above.
            frame: Number of the frame; random numbers should depend on it.

        Returns:
            N finite pose vectors, shape (N, 6), and their fitness (0 to 1), shape (N,), the
            recognized one first; and its covariance, shape (6, 6), where that is known. A tracker
            that finds nothing in the images returns the carried poses with a fitness of 0 and
            without a covariance: so motion feedforward bridges the gap.
        """
        ...
