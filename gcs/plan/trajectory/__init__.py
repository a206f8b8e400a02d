"""Plans as polynomials of time, on disk too, and the phases that join them to the ground."""
