"""The commands about vehicles and flights: fly, attach, replay, report, vehicles and tell.

It may import cli.planning, cli.shared, autopilots, scenario, plan, mission, link, flight and page.
"""
