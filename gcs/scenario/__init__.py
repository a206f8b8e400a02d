"""Scenarios: from `scenario.toml` to checked values in SI units.

It imports leaves only.
"""
