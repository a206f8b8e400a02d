"""Recorded conversations with real autopilots, played against the emulated vehicles and compared."""
