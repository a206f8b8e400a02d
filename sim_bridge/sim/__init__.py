"""The simulation loop: the vehicles of a scenario, their pace, and the record of true states.

It may import sim_bridge.autopilot, sim_bridge.autopilot.guidance, sim_bridge.dynamics, sim_bridge.faults,
sim_bridge.missions, sim_bridge.personality, sim_bridge.protocol, sim_bridge.protocol.telemetry, gcs.autopilots,
gcs.scenario and gcs.link.
"""
