"""The pictures of plans, flights and replays.

It may import flight.monitoring, flight.recording, scenario and plan.
"""
