"""Re-planning in flight: programs that are built once and solved again from any state.

It may import plan.formation, plan.nlp, plan.ocp, plan.search, plan.trajectory and scenario.
"""
