"""Physics: Eqs. 1 and 2 of a quadrotor, the power of its rotors, steady wind.

It imports leaves only.
"""
