"""Skein: plan, check and fly formations of quadrotors over MAVLink."""
