"""What of a mission item survives on board: one table per autopilot, read by the comparison of a read-back."""
