"""What is seen live? Poses, hypotheses and cameras in Meshcat, and its buttons."""
