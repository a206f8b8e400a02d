"""From a scenario to a verified plan: the only room that knows optimisation."""
