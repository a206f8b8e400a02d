"""Checks of mission files of any program: items, predicted flights, fences and rally points.

It may import mission.formats, mission.predicted, autopilots, scenario, plan and mission.
"""
