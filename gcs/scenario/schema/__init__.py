"""The tables of `scenario.toml`: keys, units, ranges, defaults.

It may import autopilots.
"""
