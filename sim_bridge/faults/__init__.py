"""Fault injection: how faults are written, when they are active, and what they do."""
