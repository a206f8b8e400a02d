"""Trajectories of any planner: read from files, and proved at every instant as plans are.

It may import mission.formats, mission.formats.tables, mission.predicted, mission.returns, scenario, plan and
mission.
"""
