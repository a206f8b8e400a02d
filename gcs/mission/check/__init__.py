"""Checks of mission files, ours or not: items, flights, fences and rally points."""
