"""Guidance: the reference trajectory of one vehicle, as polynomials in time, within its motion limits."""
