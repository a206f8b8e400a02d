"""Optimal trajectories: from a scenario to a verified plan and its file.

It may import plan.formation, plan.nlp, plan.ocp, plan.search, plan.trajectory, plan.verification and scenario.
"""
