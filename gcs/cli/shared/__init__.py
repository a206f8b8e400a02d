"""What all commands share: their output, their common options, and the MISSION argument.

It may import scenario, plan, link, flight and page.
"""
