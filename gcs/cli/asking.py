"""A question to the person at the keyboard, while vehicles go on being listened to.

Knows: standard input, the event loop. Does not know: what is asked, screens.
"""

from __future__ import annotations

import asyncio
import sys


async def typed_line() -> str:
    """The next line of standard input without its end; empty where there is none. May be cancelled at any time."""
    if sys.stdin is None or sys.stdin.closed:
        return ""
    loop = asyncio.get_running_loop()
    came = asyncio.Event()
    try:
        loop.add_reader(sys.stdin, came.set)
    except PermissionError:  # a file: it is all there
        return sys.stdin.readline().strip()
    try:
        await came.wait()
    finally:
        loop.remove_reader(sys.stdin)
    return sys.stdin.readline().strip()
