"""Rules between the tables of a scenario, and errors that suggest what was meant.

It may import scenario.environment, scenario.schema and scenario.values.
"""
