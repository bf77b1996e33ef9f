"""Recordings: images with their rig and its motion; written from scenarios, and tracked."""
