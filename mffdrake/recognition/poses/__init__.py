"""Where is it? Pose vectors, their motion, and a filter over time."""
