"""A plan, a recorded flight, or a flight under way as plain values over time: what a page or a picture shows.

It may import flight.monitoring, flight.recording, autopilots, scenario, plan and mission.
"""
