"""A target's motion from a file."""

from __future__ import annotations

from functools import cached_property

from pydrake.math import RigidTransform, RotationMatrix
from pydrake.trajectories import PiecewisePose

from mffdrake.recognition.parameters import Text, parameters, shown
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.recordings.trajectory import LoadTrajectory
from mffdrake.systems.arms.models import DescribeMissing
from mffdrake.systems.target_motion.target_motion import TargetMotion

__all__ = ["TrajectoryFile"]


@parameters
class TrajectoryFile(TargetMotion):
    """The target's poses X_WM from a TUM or CSV file, linear in between.

    Before the first pose and after the last one it stays there. The scenario's X_WM does not count.

    Attributes:
        file: Its path: ``time x y z qx qy qz qw`` a line, [s] and [m]. A relative one is looked for
            beside the scenario file that names it, then from the current folder.

    Raises:
        ValueError: When the file cannot be read or its times do not increase.
    """

    file: Text

    def __post_init__(self) -> None:
        """Reads the file, so that what is wrong with it is told at once."""
        try:
            trajectory = LoadTrajectory(self.file)
        except FileNotFoundError as error:
            raise ValueError(f"file: {DescribeMissing(self.file)}") from error
        except OSError as error:
            raise ValueError(f"file: cannot read {shown(self.file)}: {error.strerror}") from error
        except ValueError as error:
            raise ValueError(f"file: {error}") from error
        times = trajectory.times
        if len(times) < 2 or not (times[1:] - times[:-1] > 1e-9).all():
            raise ValueError(f"file: {self.file}: there must be two poses or more, in time's order")

    def CalcPose(self, X_WM0: RigidTransform, time: float) -> RigidTransform:
        """The pose X_WM in the file, see `TargetMotion.CalcPose`."""
        del X_WM0
        poses = self._poses
        return poses.GetPose(min(max(time, poses.start_time()), poses.end_time()))

    @cached_property
    def _poses(self) -> PiecewisePose:
        trajectory = LoadTrajectory(self.file)
        R, p = transform_from_pose(trajectory.poses)
        poses = [RigidTransform(RotationMatrix(a), b) for a, b in zip(R, p, strict=True)]
        return PiecewisePose.MakeLinear(times=trajectory.times, poses=poses)
