"""The endpoints of the vehicles: UDP, TCP and pseudo terminals."""
