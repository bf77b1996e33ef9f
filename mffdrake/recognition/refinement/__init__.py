"""Where exactly? Sub-pixel refinement by color borders."""
