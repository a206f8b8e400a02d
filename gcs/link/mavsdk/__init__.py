"""The MAVSDK backend."""
