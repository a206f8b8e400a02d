"""The telemetry of one vehicle: message contents and rates. All of it comes from the estimate, never from the truth."""

from sim_bridge.protocol.telemetry.instruments import GeodeticPositions, Instruments, Sources
from sim_bridge.protocol.telemetry.streams import Telemetry

__all__ = ["GeodeticPositions", "Instruments", "Sources", "Telemetry"]
