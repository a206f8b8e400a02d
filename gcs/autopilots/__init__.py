"""What differs between the autopilots, as rows of tables: modes, commands, limits, timers, and how they fly."""
