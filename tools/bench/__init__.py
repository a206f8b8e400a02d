"""The parts of bench_planner.py."""
