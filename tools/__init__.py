"""Measurements, pictures and files that are made again by hand; nothing that flies needs them."""
