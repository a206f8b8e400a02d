"""From reference and estimate to the controls U1..U4."""
