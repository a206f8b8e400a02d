"""Where a vehicle should be, and when: every manoeuvre as polynomials in time.

Knows: kinematics and what a vehicle can do at most. Does not know: modes, MAVLink, estimates, forces.
"""
