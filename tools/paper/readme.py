"""Numbers of the README that the page measures: a comment behind each says where it stands in paper.json.

    1.27<!-- paper: scale.ratio.time -->

Knows: the comment. Does not know: what is measured. A number keeps the decimals that it is written with.
"""

from __future__ import annotations

import re
from typing import Any

MARK = re.compile(r"(?P<shown>-?\d+(?:\.(?P<decimals>\d+))?)(?P<mark><!-- paper: (?P<key>[\w.]+) -->)")


def updated(text: str, record: dict[str, Any]) -> str:
    """The text with every marked number as the record has it; raises KeyError for a mark that leads nowhere."""

    def shown(match: re.Match[str]) -> str:
        value: Any = record
        for key in match["key"].split("."):
            value = value[key]
        return f"{float(value):.{len(match['decimals'] or '')}f}{match['mark']}"

    return MARK.sub(shown, text)
