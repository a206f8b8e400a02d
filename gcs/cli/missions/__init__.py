"""The commands about missions, as files and on board: check, export, upload, download, diff and restore.

It may import cli.shared, autopilots, scenario, plan, mission, link and flight.
"""
