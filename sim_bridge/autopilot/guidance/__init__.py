"""The reference trajectory of one vehicle, as polynomials in time within its motion limits.

It may import gcs.autopilots, gcs.scenario and gcs.mission.
"""
