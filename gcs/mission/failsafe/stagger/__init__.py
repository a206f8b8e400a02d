"""The order of vehicles in the stagger of return altitudes."""
