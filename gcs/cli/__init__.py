"""The `gcs` command: it parses, calls and prints.

It may import cli.flights, cli.missions, cli.planning and cli.shared.
"""
