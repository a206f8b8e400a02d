"""The personality of PX4 1.17, as recorded."""
