"""What ``mffdrake calibrate hand-eye`` does, and its options."""

from __future__ import annotations

import argparse
import logging
import math
from typing import Any

__all__ = ["AddCalibrate", "RunCalibrate"]

_log = logging.getLogger("mffdrake")

_LEAST_TURN = 10.0  # [deg]


def AddCalibrate(commands: Any) -> None:
    """Adds the command to the command line's parsers; imports nothing that is slow."""
    calibrate = commands.add_parser(
        "calibrate", help="where the camera is on the hand",
        description="Calibrations from poses that were tracked.",
    )  # fmt: skip
    kinds = calibrate.add_subparsers(dest="what", required=True, metavar="hand-eye")
    hand_eye = kinds.add_parser(
        "hand-eye", help="the camera's pose on the hand",
        description="Finds the camera's pose on the hand, X_EC, from poses of a target at rest and "
        "of the hand at the same times.",
    )  # fmt: skip
    add = hand_eye.add_argument
    form = "a line 'time x y z qx qy qz qw' each"
    add("--poses", metavar="POSES.tum", required=True,
        help=f"the target in the camera, {form}: track's poses.tum")  # fmt: skip
    add("--hand", metavar="HAND.tum", required=True,
        help=f"the hand in the arm's base, {form}; interpolated between its times")  # fmt: skip


def RunCalibrate(options: argparse.Namespace) -> int:
    """Calibrates, and prints what came out."""
    import numpy as np

    from mffdrake.experiment.commands.options.arguments import ArgumentsError
    from mffdrake.recognition.camera.hand_eye import calibrate_hand_eye
    from mffdrake.recognition.poses.pose import quaternion_scalar, transform_from_pose
    from mffdrake.recognition.recordings.trajectory import LoadTrajectory, PoseAt

    poses, hand = LoadTrajectory(options.poses), LoadTrajectory(options.hand)
    order = np.argsort(hand.times, kind="stable")
    pairs = []
    for time, pose in zip(poses.times.tolist(), poses.poses, strict=True):
        X_BE = PoseAt(hand.times[order], hand.poses[order], time)
        if X_BE is not None:
            pairs.append((X_BE, pose))
    if not pairs:
        raise ArgumentsError(
            f"{options.hand} has no pose at the times of {options.poses}: from "
            f"{hand.times.min():.3f} to {hand.times.max():.3f} s, and from {poses.times.min():.3f} "
            f"to {poses.times.max():.3f} s"
        )
    if len(pairs) < len(poses):
        _log.warning("left out %d of %d poses, at whose times %s has none",
                     len(poses) - len(pairs), len(poses), options.hand)  # fmt: skip
    found = calibrate_hand_eye(*(np.array(column) for column in zip(*pairs, strict=True)))
    R, _ = transform_from_pose(found.X_EC)
    turn = math.degrees(found.turn)
    if turn < _LEAST_TURN:
        _log.warning("the hand turned by %.1f deg only about a second axis: X_EC is told better by "
                     "motions of %.0f deg or more about two axes", turn, _LEAST_TURN)  # fmt: skip
    place = [round(float(c), 6) for c in found.X_EC[:3]]
    quaternion = [*found.X_EC[3:].tolist(), float(quaternion_scalar(found.X_EC[3:]))]
    rpy = [
        math.atan2(R[2, 1], R[2, 2]),
        math.atan2(-R[2, 0], math.hypot(R[2, 1], R[2, 2])),
        math.atan2(R[1, 0], R[0, 0]),
    ]
    angles = [round(math.degrees(angle), 4) for angle in rpy]
    outliers = int((~found.used).sum())
    print(f"{len(pairs)} poses" + f", of which {outliers} are outliers" * (outliers > 0))
    print(f"Residuals, root mean square: {1e3 * found.rms_position:.3f} mm, "
          f"{math.degrees(found.rms_rotation):.4f} deg")  # fmt: skip
    print(f"X_EC, the camera on the hand, give or take {1e3 * found.std_position:.3f} mm and "
          f"{math.degrees(found.std_rotation):.4f} deg:")  # fmt: skip
    print(f"translation x y z [m]: {' '.join(f'{c:.6f}' for c in place)}")
    print(f"quaternion qx qy qz qw: {' '.join(f'{c:.8f}' for c in quaternion)}")
    print("As a camera's X_PB in a scenario, or X_CK in a rig whose frame is the hand's:")
    print(f"{{translation: {place}, rotation: !Rpy {{deg: {angles}}}}}")
    return 0
