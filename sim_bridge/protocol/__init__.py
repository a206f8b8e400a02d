"""The MAVLink side of one vehicle: commands, parameters, setpoints and endpoints.

It may import sim_bridge.autopilot, sim_bridge.autopilot.guidance, sim_bridge.missions, sim_bridge.personality,
sim_bridge.protocol.telemetry, gcs.mission and gcs.link.
"""
