"""Missions and setpoints made from a plan, as values and as files.

It may import scenario.
"""
