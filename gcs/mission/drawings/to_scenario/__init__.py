"""The scenario of a drawn route or area.

It may import mission.drawings and scenario.
"""
