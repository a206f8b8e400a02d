"""Waypoint missions of a plan: placement of waypoints, speeds of legs, mission items.

It may import autopilots, scenario, plan and mission.
"""
