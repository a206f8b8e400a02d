"""The `gcs` command: it parses, calls and prints; `command_table` names the module of each command, loaded when called.

It may import cli.planning, cli.shared and scenario.
"""
