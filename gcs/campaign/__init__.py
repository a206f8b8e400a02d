"""Campaigns of many emulated flights: the design, the workers, the table of results, and statistics of it.

It may import scenario, plan and flight.
"""
