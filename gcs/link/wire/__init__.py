"""MAVLink frames: codec and signing. Only the codec imports pymavlink.

It imports leaves only.
"""
