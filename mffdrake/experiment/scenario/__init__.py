"""What can be set? Everything that a simulation depends on."""
