"""The live view of a flight: which vehicles fit the screen, and their table."""
