"""What the vehicles of a plan see of a survey's area."""
