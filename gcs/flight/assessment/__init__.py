"""The verdict on a flight, and its deviations from the plan.

It may import flight.monitoring, scenario, plan and mission.
"""
