"""How accurate the poses are, on drawn and on real images."""
