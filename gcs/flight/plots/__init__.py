"""The pictures of plans, flights and replays.

It may import flight.monitoring, flight.recording, flight.scene, scenario, plan and mission.
"""
