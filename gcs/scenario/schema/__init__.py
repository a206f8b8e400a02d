"""The tables of `scenario.toml`: keys, units, ranges, defaults."""
