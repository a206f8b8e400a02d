"""The controller: from reference and estimate to the controls U1..U4."""
