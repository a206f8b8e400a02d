"""Returns of the whole fleet (RTL): fences, rally points, staggered altitudes, and the proof of their separation.

It may import mission.predicted, autopilots, scenario, plan and mission.
"""
