"""What is seen of it? Points, aspects and outlines."""
