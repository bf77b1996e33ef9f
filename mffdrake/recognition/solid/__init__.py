"""What is the target? A colored, closed surface, and its symmetries."""
