"""What moves the cameras? Arms, their kinematics, the hand's path."""
