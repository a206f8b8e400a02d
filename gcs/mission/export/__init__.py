"""The setpoint stream of a plan, and the export folder, which is written, read back, verified and replaced whole.

It may import mission.check, mission.formats, mission.formats.maps, mission.formats.tables, mission.predicted,
mission.returns, mission.waypoints, autopilots, scenario, plan and mission.
"""
