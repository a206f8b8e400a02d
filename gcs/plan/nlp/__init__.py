"""The Gauss pseudospectral method: transcription, IPOPT, mesh refinement (Eqs. 36-50).

It may import plan.formation, plan.ocp, plan.trajectory and scenario.
"""
