"""Routes and areas that people drew in other programs.

It may import mission.formats, autopilots and mission.
"""
