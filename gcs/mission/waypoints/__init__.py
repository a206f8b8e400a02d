"""From a plan to waypoint missions: where waypoints lie, at what speeds they are flown, as which items."""
