"""The sequence of a flight: upload, arm, take off, fly, land."""
