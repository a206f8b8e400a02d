"""Upload to the whole fleet: all vehicles, or none."""
