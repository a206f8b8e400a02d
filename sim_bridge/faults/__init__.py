"""Faults on demand: how they are written, when they are in force, what they do."""
