"""MAVLink's smaller services: commands, parameters, time synchronisation, STATUSTEXT."""
