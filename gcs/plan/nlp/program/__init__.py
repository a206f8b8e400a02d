"""The nonlinear program of one problem on one mesh: unknowns, bounds, rows and exact derivatives."""
