"""The MAVLink mission protocol as state machines: upload, read-back, download, and single items replaced.

It may import link.protocols, link.protocols.ftp, link.wire, autopilots and mission.
"""
