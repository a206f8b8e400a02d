"""Models of the autopilots' waypoint navigators, which predict the position of a vehicle over time.

It imports leaves only.
"""
