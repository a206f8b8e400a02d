"""A scenario's values as later layers use them: SI units, shapes, navigation error, reachable accelerations.

It may import scenario.environment, scenario.schema and autopilots.
"""
