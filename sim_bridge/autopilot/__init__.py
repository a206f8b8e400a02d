"""The decisions of one vehicle: flight modes, arming, failsafes, landing detection and mission progress.

It may import sim_bridge.autopilot.guidance, sim_bridge.missions, sim_bridge.personality and gcs.mission.
"""
