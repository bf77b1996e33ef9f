"""What draws? Renderers, surfaces, graphics and Meshcat."""
