"""The ground and the no-fly zones of a scenario.

It may import scenario.schema.
"""
