"""What recognizes? The recognizer, motion feedforward and the target's motion."""
