"""Timed setpoints from a plan, and their B-spline smoothing."""
