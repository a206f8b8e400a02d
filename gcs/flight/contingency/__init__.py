"""Decisions when something goes wrong in flight: incidents, policy, ordered tracks. Time is an argument.

It may import flight.monitoring, autopilots, scenario, plan, mission and link.
"""
