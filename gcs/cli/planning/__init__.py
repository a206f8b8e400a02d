"""The commands about scenarios and plans: new, schema, show, plan, verify and replan.

It may import cli.shared, scenario, plan, mission, flight and page.
"""
