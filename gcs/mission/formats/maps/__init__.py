"""Formats of maps: KML, KMZ, GeoJSON."""
