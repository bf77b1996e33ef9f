"""Where do they run? In this process, in others, on a cluster."""
