"""One vehicle's side of MAVLink: commands, parameters, missions, telemetry, and its endpoints."""
