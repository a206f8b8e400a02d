"""What differs between the autopilots: one table with a row for each, and models of how they fly waypoints."""
