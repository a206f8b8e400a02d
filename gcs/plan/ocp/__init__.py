"""The leader's optimal control problem, with every follower's constraints folded in (Eqs. 15-35, 51).

It may import plan.formation, plan.trajectory and scenario.
"""
