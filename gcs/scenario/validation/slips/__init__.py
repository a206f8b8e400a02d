"""Slips in a scenario: mistyped keys, units after numbers, degrees; and the error that lists all mistakes."""
