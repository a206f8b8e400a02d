"""The predicted flight of a mission, at planned speeds and by a model of its autopilot.

It may import mission.formats, mission.waypoints, autopilots, scenario, plan and mission.
"""
