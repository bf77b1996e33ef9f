"""Where to begin? Poses proposed by blobs of color."""
