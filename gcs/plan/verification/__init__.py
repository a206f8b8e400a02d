"""The verdict on a plan, computed from its polynomials alone.

It may import plan.formation, plan.trajectory, plan.verification.constraints, plan.verification.proof and scenario.
"""
