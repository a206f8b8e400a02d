"""How autopilots fly waypoints: models that predict when a vehicle is where.

Knows: waypoints, speeds asked for, and what recordings of real autopilots taught. Does not know: mission items,
MAVLink, plans. Who writes missions can ask what they will become; emulated vehicles fly the answer.
"""
