"""Physics, control and estimation of the whole fleet, one batch of arrays."""
