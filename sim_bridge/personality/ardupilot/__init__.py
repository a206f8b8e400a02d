"""The personality of ArduCopter 4.5.6, as recorded."""
