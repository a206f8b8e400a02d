"""The ground station's side of MAVLink FTP as state machines.

It may import link.protocols and link.wire.
"""
