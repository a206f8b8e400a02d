"""What a vehicle tells of itself, and how often.

Knows: how states become message fields; intervals in simulated time. Does not know: sockets, decisions. Everything
comes from the estimate: a vehicle does not know where it truly is.
"""

from sim_bridge.protocol.telemetry.instruments import Instruments, Whereabouts
from sim_bridge.protocol.telemetry.sources import Sources
from sim_bridge.protocol.telemetry.streams import Telemetry
from sim_bridge.protocol.telemetry.vitals import heartbeat

__all__ = ["Instruments", "Sources", "Telemetry", "Whereabouts", "heartbeat"]
