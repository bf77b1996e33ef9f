"""What moves the arm? Controllers, gains and encoders."""
