"""The conversation with vehicles: machines without sockets or clocks inside, sockets and clocks at the rim.

Knows: MAVLink 2, missions as items, commands, time. Does not know: plans, flights, judgements.
"""
