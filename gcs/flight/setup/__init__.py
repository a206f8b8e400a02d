"""Preparation of a flight: its missions, the load of each vehicle, pre-flight checks, the simulator.

It may import flight.contingency, flight.monitoring, autopilots, scenario, plan, mission and link.
"""
