"""Mission file formats, our own and those of other programs, with the table of export formats (`registry`).

It may import autopilots and mission.
"""
