"""Optimal trajectories: from a scenario to a verified plan and its file.

It may import plan.formation, plan.nlp, plan.ocp, plan.replanning, plan.search, plan.trajectory, plan.verification,
plan.verification.constraints and scenario.
"""
