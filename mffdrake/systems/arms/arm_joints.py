"""The joints that move an arm: their order, their units, and the posture near which they stay."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydrake.multibody.tree import PrismaticJoint

from mffdrake.recognition.parameters import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy as np
    from numpy.typing import NDArray
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import Joint, ModelInstanceIndex

__all__ = ["POSE_SIZE", "ArmError", "CheckPosture", "JointNames", "MovingJoints", "UnitOf"]

POSE_SIZE = 6
"""Number of joints that a hand pose takes."""


class ArmError(InputError, ValueError):
    """The arm's description does not make an arm; the message is one line that says why.

    Example:
        >>> from mffdrake.systems.arms.hand_path import HandPath, SolveHandPath
        >>> from mffdrake.systems.arms.pa10 import MakePa10Plant
        >>> try:
        ...     SolveHandPath(MakePa10Plant(), HandPath(), duration=1.0, held_joints=["elbow"])
        ... except ArmError as error:
        ...     print(str(error).partition(". ")[0])
        arm: held_joints names elbow, but the joints are S1, S2, S3, E1, E2, W1, W2
    """


def MovingJoints(
    plant: MultibodyPlant, model_instance: ModelInstanceIndex | None = None
) -> list[Joint]:
    """The joints that move, in the order of their positions: an arm's from base to tip.

    Args:
        plant: A finalized plant.
        model_instance: The model; by default the whole plant.

    Returns:
        The joints.
    """
    indices = (
        plant.GetJointIndices() if model_instance is None else plant.GetJointIndices(model_instance)
    )
    joints = [plant.get_joint(i) for i in indices]
    return sorted(
        (joint for joint in joints if joint.num_positions() > 0),
        key=lambda joint: joint.position_start(),
    )


def JointNames(joints: Iterable[Joint]) -> str:
    """Their names, as messages have them."""
    return ", ".join(joint.name() for joint in joints)


def UnitOf(joint: Joint) -> str:
    """Unit of a joint's position: ``m`` where it slides, ``rad`` where it turns."""
    return "m" if isinstance(joint, PrismaticJoint) else "rad"


def CheckPosture(
    joints: Sequence[Joint], nominal: NDArray[np.float64], held_joints: Sequence[str]
) -> None:
    """Checks the posture near which an arm stays, and what is left of it to move.

    Args:
        joints: The arm's joints.
        nominal: Their nominal positions [rad, or m where a joint slides].
        held_joints: Names of those that stay there.

    Raises:
        ArmError: If there is not one position for each joint, within its limits, or if fewer than
            six joints are left to lead the hand.
    """
    names = [joint.name() for joint in joints]
    if len(nominal) != len(joints):
        raise ArmError(
            f"arm: the nominal posture (nominal_deg) must have {len(joints)} numbers, one for each "
            f"of {', '.join(names)}, not {len(nominal)}."
        )
    unknown = [name for name in held_joints if name not in names]
    if unknown:
        raise ArmError(
            f"arm: held_joints names {', '.join(unknown)}, but the joints are "
            f"{', '.join(names)}. Use these names, or [] to hold none."
        )
    num_free = len(set(names) - set(held_joints))
    if num_free < POSE_SIZE:
        raise ArmError(
            f"arm: held_joints leaves {num_free} of {len(joints)} joints, but a hand pose takes "
            f"{POSE_SIZE}. Hold fewer."
        )
    for joint, position in zip(joints, nominal, strict=True):
        lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        if not lower <= position <= upper:
            raise ArmError(
                f"arm: the nominal posture (nominal_deg) has joint {joint.name()} at "
                f"{position:.3f}, outside its limits {lower:.3f} to {upper:.3f} {UnitOf(joint)}. "
                "Move it inside."
            )
