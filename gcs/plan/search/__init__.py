"""The search around the optimisation: routes, initial guesses, changes of shape, free final times.

It may import plan.formation, plan.nlp, plan.ocp, plan.trajectory and scenario.
"""
