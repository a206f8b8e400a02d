"""Routes that people drew in other programs: read into a `Drawing`, and written as a scenario."""
