"""From a plan to missions and setpoints, as values and as files."""
