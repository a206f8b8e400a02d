"""One vehicle's conversation, and the fleet of all vehicles on the links."""
