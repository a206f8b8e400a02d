"""The vehicle bodies and the air: Eq. 1, motors, batteries, sensors, wind and failures."""
