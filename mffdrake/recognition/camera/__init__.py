"""What does a camera do? Lenses, rigs and calibration files."""
