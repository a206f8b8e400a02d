"""Plans as polynomials of time, and the phases that join them to the ground.

It may import plan.formation, autopilots and scenario.
"""
