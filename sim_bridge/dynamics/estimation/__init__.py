"""The state estimator: an extended Kalman filter per vehicle, computed as one batch."""
