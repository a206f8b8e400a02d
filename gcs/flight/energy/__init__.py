"""The battery in flight: its measured discharge, and what the charge that is left allows."""
