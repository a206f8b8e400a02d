"""The folder that a flight leaves on disk, and recordings read again.

It may import flight.assessment, flight.contingency, flight.monitoring, flight.setup, autopilots, scenario, plan and
link.
"""
