"""From a plan to waypoint missions: placement of waypoints, speeds of legs, mission items."""
