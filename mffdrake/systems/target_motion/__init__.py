"""How a target moves through the world: prescribed motions, as functions of time.

A motion is a class of parameters. A new one is a file here and a name in a scenario's union of
them.
"""

from mffdrake.systems.target_motion.at_rest import AtRest
from mffdrake.systems.target_motion.sinusoids import Sinusoids
from mffdrake.systems.target_motion.step import Step
from mffdrake.systems.target_motion.straight import Straight
from mffdrake.systems.target_motion.target_motion import OffsetMotion, TargetMotion
from mffdrake.systems.target_motion.waypoints import Waypoint, Waypoints

__all__ = [
    "AtRest",
    "OffsetMotion",
    "Sinusoids",
    "Step",
    "Straight",
    "TargetMotion",
    "Waypoint",
    "Waypoints",
]
