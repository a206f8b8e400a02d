"""The smaller MAVLink services: commands, parameters, time synchronisation, STATUSTEXT."""
