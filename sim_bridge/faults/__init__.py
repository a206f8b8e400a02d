"""Fault injection: how faults are written, when they are active, and what they do.

It may import sim_bridge.dynamics, sim_bridge.protocol and gcs.link.
"""
