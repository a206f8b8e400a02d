"""The commands about vehicles and flights: fly, tell, attach, replay, report and vehicles.

It may import cli.planning, cli.shared, autopilots, scenario, plan, mission, link, flight and page.
"""
