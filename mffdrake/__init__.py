"""mffdrake."""
