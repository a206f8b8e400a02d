"""How a formation changes its shape: rotation, shrinking, reassignment, and when they happen."""
