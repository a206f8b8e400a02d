"""Models of the autopilots' waypoint navigators: they predict the position of a vehicle over time."""
