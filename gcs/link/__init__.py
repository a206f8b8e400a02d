"""The link to vehicles: protocol machines without sockets or clocks, and around them sessions, sockets and timers."""
