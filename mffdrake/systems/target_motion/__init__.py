"""How a target moves through the world: prescribed motions, as functions of time.

A motion is a class of parameters. A new one is a class here and a name in a scenario's union of
them.
"""

from mffdrake.systems.target_motion.simple_motions import AtRest, Step, Straight
from mffdrake.systems.target_motion.sinusoids import Sinusoids
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
