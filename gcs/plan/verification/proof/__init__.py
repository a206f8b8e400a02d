"""Bounds that hold at every instant of an interval, and the subdivision that makes them tight.

It may import plan.formation, plan.trajectory and scenario.
"""
