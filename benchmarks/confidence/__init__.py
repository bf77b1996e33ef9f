"""How the confidence is fitted, and how reliable it is."""
