"""The predicted flight of a mission: as planned, and as a model of the autopilot flies it."""
