"""The telemetry of one vehicle, from its estimate and never from the truth: message contents and rates.

It may import sim_bridge.autopilot, sim_bridge.dynamics, sim_bridge.personality and gcs.link.
"""

from sim_bridge.protocol.telemetry.instruments import GeodeticPositions, Instruments, Sources
from sim_bridge.protocol.telemetry.streams import Telemetry

__all__ = ["GeodeticPositions", "Instruments", "Sources", "Telemetry"]
