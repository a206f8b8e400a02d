"""The formation as a virtual rigid body that may turn, shrink and be reassigned (§2.2).

It may import scenario.
"""
