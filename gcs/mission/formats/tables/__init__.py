"""Formats of tables: setpoints as CSV and Parquet, histories as CSV."""
