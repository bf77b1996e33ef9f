"""What runs the hand-eye system and looks at it: scenarios, simulation, results, command line."""
