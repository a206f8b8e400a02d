"""The page in a browser, in a process of its own: it shows a scene, and the pictures of a flight under way.

It imports leaves only.
"""
