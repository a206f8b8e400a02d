"""What differs between autopilots: one table with a row for each of them.

It may import autopilots.waypoint_models.
"""
