"""The session with one vehicle, and the fleet of all vehicles on the links."""
