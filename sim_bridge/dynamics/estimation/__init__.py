"""What vehicles believe: an extended Kalman filter each, stepped as one batch."""
