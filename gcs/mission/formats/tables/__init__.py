"""The table formats: setpoints as CSV and Parquet, histories as CSV.

It may import plan and mission.
"""
