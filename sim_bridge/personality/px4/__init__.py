"""PX4 1.17, as recorded."""
