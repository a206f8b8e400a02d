"""The map formats: KML, KMZ and GeoJSON.

It may import scenario, plan and mission.
"""
