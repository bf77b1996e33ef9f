"""What do cameras see, and when? Sensors, frames, lenses, latency."""
