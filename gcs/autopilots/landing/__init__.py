"""How vehicles descend in the landing of their own autopilot."""
