"""The commands about vehicles and flights: fly, attach, campaign, replay, report, vehicles and tell.

It may import cli.planning, cli.shared, autopilots, scenario, plan, mission, link, flight, campaign and page.
"""
