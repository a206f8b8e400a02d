"""Endpoints that send and receive bytes: UDP, TCP and serial lines.

It imports leaves only.
"""
