"""How far the position that a vehicle reports may be from its true one, 3 sigma, by its own messages.

The receiver says how accurate it is (GPS_RAW_INT.h_acc, v_acc), PX4's estimator too (ESTIMATOR_STATUS); the larger one
counts. The estimator's test ratio is the share of its gate by which it disagrees with the receiver: at 1 it ignores
the receiver.
"""

from __future__ import annotations

import math

from gcs.link.wire.message import Message
from gcs.scenario.values.navigation_error import NavigationError

_SIGMAS = 3.0
_FIX_3D = 3
_RATIOS = {
    "EKF_STATUS_REPORT": ("pos_horiz_variance", "pos_vert_variance"),
    "ESTIMATOR_STATUS": ("pos_horiz_ratio", "pos_vert_ratio"),
}


class ReportedAccuracy:
    """The accuracy of one vehicle's reports, as last told; that of `unknown` where the receiver tells none."""

    def __init__(self, unknown: NavigationError) -> None:
        self._unknown = (unknown.horizontal_m, unknown.vertical_m)
        self._has_fix = True
        self._receiver_m = (0.0, 0.0)  # 1 sigma, horizontal and vertical; 0: not told
        self._estimator_m = (0.0, 0.0)
        self._ratios = (0.0, 0.0)

    def receive(self, message: Message) -> None:
        """Take in a message of the vehicle."""
        fields = message.fields
        if message.name == "GPS_RAW_INT":
            self._has_fix = fields["fix_type"] >= _FIX_3D
            self._receiver_m = fields.get("h_acc", 0) / 1e3, fields.get("v_acc", 0) / 1e3
        if message.name == "ESTIMATOR_STATUS":
            self._estimator_m = _finite(fields["pos_horiz_accuracy"]), _finite(fields["pos_vert_accuracy"])
        if message.name in _RATIOS:
            self._ratios = _finite(fields[_RATIOS[message.name][0]]), _finite(fields[_RATIOS[message.name][1]])

    @property
    def within_m(self) -> tuple[float, float]:
        """The horizontal and the vertical distance; infinite without a fix, or with a receiver that is ignored."""
        if not self._has_fix and not self._estimator_m[0]:
            return math.inf, math.inf
        horizontal_m, vertical_m = (
            math.inf
            if ratio >= 1.0
            else (1.0 + ratio) * (_SIGMAS * max(told_m, estimated_m) if told_m or estimated_m else unknown_m)
            for told_m, estimated_m, unknown_m, ratio in zip(
                self._receiver_m, self._estimator_m, self._unknown, self._ratios, strict=True
            )
        )
        return horizontal_m, vertical_m


def _finite(value: float) -> float:
    return float(value) if math.isfinite(value) else 0.0
