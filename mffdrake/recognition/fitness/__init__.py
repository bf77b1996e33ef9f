"""How well does a pose match? Colors, points and images."""
