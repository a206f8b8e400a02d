"""Leaves of physics: Eq. 1 of a quadrotor, the power its rotors draw, the wind."""
