"""The MAVLink side of one vehicle: commands, parameters, missions, telemetry and endpoints."""
