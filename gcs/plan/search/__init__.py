"""What is searched before and around the optimisation: routes, initial guesses, shape schedules, final times."""
