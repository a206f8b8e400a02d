"""The verdict on a plan, computed from its polynomials alone."""
