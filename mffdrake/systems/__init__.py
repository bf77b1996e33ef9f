"""The parts of the hand-eye system, each a Drake system one can take alone."""
