"""Navigator parameters, identified from recordings.

Every value is a parameter that the autopilot reported, or its default, except two for each autopilot, which are fitted.
ArduPilot: the vehicle's lag and drag. PX4 (the drag of its simulator is known): the part of the integral that it gives
back in descents, and the error of home's altitude in the first two minutes of flight. That error is noise: it decides
at which waypoints PX4 brakes. `tools/fit_navigator.py` reproduces the fitted values and the residuals.
"""

from gcs.autopilots.waypoint_models.ardupilot_navigator import ArduPilotNavigator
from gcs.autopilots.waypoint_models.px4_navigator import Px4Navigator
from gcs.autopilots.waypoint_models.tracking import Following, Loop

# ArduCopter 4.5.6 (its own simulator). PSC_POSXY_P, _VELXY_P, _I, _D; the vertical loop does not change arrival times.
ARDUPILOT = ArduPilotNavigator(
    Following(Loop(1.0, 2.0, 1.0, 0.5, True), Loop(1.0, 5.0, 1.0, 0.0, True), lag_s=0.075, drag_ps=0.369)
)
# PX4 1.17 (its simulator of a 1 kg vehicle). MPC_XY_P, _VEL_P_ACC, _VEL_I_ACC, _VEL_D_ACC and those of Z.
PX4 = Px4Navigator(
    Following(
        Loop(0.95, 1.8, 0.4, 0.2, False), Loop(1.0, 4.0, 2.0, 0.0, False), lag_s=0.15, drag_ps=1.0, unwinding=1.186
    ),
    height_error_m=0.544,
)
