"""The constraints of a plan, each as a margin that is bounded over intervals of time.

It may import plan.formation, plan.trajectory, plan.verification.proof and scenario.
"""
