"""The parts of figures.py: what formations that change their shape look like."""
