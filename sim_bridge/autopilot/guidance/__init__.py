"""The reference trajectory of one vehicle, as polynomials in time within its motion limits.

It may import sim_bridge.dynamics, gcs.autopilots, gcs.scenario and gcs.mission.
"""
