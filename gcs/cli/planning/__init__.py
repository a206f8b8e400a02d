"""The commands about scenarios and plans: new, new-vehicle, schema, show, plan, verify, prove and replan.

It may import cli.shared, autopilots, scenario, plan, mission, flight and page.
"""
