"""One flight, from the verified plan to the verdict.

It may import flight.assessment, flight.contingency, flight.execution, flight.monitoring, flight.plots,
flight.recording, flight.setup, scenario, plan, mission and link.
"""
