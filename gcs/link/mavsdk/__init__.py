"""MAVSDK as a backend: the only room that imports it."""
