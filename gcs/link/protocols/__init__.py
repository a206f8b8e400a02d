"""The smaller MAVLink services as state machines: commands, parameters, time synchronisation, STATUSTEXT.

It may import link.wire and autopilots.
"""
