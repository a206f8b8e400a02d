"""Recorded leaders and followers, joined to a loop that answers to setpoints."""
