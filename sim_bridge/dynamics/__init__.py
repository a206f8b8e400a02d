"""Physics, control and estimation of the whole fleet, computed as one batch of arrays.

It may import gcs.scenario.
"""
