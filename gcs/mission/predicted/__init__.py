"""The predicted flight of a mission: at planned speeds, and by a model of its autopilot."""
