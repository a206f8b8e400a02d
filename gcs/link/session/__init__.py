"""The sessions with vehicles, by our own protocols or by MAVSDK: discovery, routing, status, and uploads to a fleet.

It may import link.endpoints, link.protocols, link.protocols.mission, link.wire, autopilots and
mission.
"""
