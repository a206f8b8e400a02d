"""The parameters with which a vehicle returns (RTL) as it was verified, and the top of its fence.

Names and units stand in each autopilot's row (`ReturnBehaviour.parameters`).
"""

from __future__ import annotations

import math

from gcs.autopilots.columns import ReturnParameters, ReturnSettings
from gcs.autopilots.traits import Autopilot
from gcs.mission.failsafe.rtl_altitudes import ReturnPlan

_ROUND_OFF_M = 0.01  # heights are sums that end on whole metres; their last bits shall not raise the fence
_TAKEOFF_DECIMALS = 3
FENCE_ABOVE_M = 10.0  # above the highest return: ArduPilot returns no higher than FENCE_MARGIN (2 m) below its fence


def return_parameters(
    firmware: Autopilot, returns: ReturnPlan, row: int, home_m: float, takeoff_m: float
) -> ReturnParameters:
    """Return the parameters of the vehicle in this row, with home `home_m` above the origin and a hover at `takeoff_m`.

    Altitudes count from its home. The top of the fence is rounded up to whole metres.
    """
    speeds = returns.speeds
    settings = ReturnSettings(
        altitude_m=returns.altitudes_m[row],
        cruise_mps=speeds.cruise_mps,
        climb_mps=speeds.climb_mps,
        sink_mps=speeds.sink_mps,
        wait_s=firmware.traits.returns.wait_s,
        fence_top_m=float(math.ceil(returns.top_m - home_m + FENCE_ABOVE_M - _ROUND_OFF_M)),
        takeoff_m=round(takeoff_m, _TAKEOFF_DECIMALS),
    )
    return firmware.traits.returns.parameters(settings)
