"""Where the vehicles' bytes come from and go to: UDP, TCP, pseudo terminals.

Knows: sockets, files, stations' addresses. Does not know: messages, vehicles, simulated time.
"""
