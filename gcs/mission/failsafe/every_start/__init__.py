"""Proofs that hold for every return (RTL) of a plan, at whatever instant it begins."""
