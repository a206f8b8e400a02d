"""Campaigns of many emulated flights: the design, the table of results, and statistics of it.

It imports leaves only.
"""
