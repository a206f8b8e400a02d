"""Bodies and the air: Eq. 1, motors, batteries, sensors, wind, failures."""
