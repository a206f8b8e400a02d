"""The loop of all vehicles: pace, lockstep with setpoint streams, the record of truth."""
