"""Helpers without knowledge of flying: asyncio, caches, atomic writes, bounded reading of foreign files.

It imports leaves only.
"""
