"""Checks of mission files of any program: items, flights, fences and rally points."""
