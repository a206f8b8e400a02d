"""From `scenario.toml` to a checked scenario in SI units."""
