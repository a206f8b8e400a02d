"""Orders that are repeated until a vehicle carries them out, and the landing of a fleet."""
