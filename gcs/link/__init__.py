"""The link to the vehicles: protocol machines without sockets or clocks, and sessions that run them.

It imports leaves only.
"""
