"""What is known of a flight while it lasts: progress, deviations, separations, and the time of the fleet.

It may import autopilots, scenario, plan, mission and link.
"""
