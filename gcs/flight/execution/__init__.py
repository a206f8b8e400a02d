"""The flight itself: take-off, setpoint stream, the orders of the contingency policy, landing.

It may import flight.contingency, flight.monitoring, flight.recording, flight.setup, autopilots, scenario, plan,
mission and link.
"""
