"""Positions and shapes from spreadsheets (CSV), and the scenario that they make."""
