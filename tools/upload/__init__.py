"""Uploads over bad links: the fake clock, the real sockets, and MAVSDK beside ours."""
