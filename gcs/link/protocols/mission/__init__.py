"""Partial writes: single items of a mission on board are replaced."""
