"""Emulated vehicles for testing ground stations: `sim-bridge` on the command line, `Fleet` in a program."""
