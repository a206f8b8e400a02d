"""The missions, fences and rally points that one vehicle stores, and their transfers.

It may import gcs.autopilots, gcs.mission and gcs.link.
"""
