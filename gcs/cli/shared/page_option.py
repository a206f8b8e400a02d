"""The option --page, and the commands that end with a page: they keep it open until Ctrl-C."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from gcs.cli.shared.console import Screen
from gcs.cli.shared.shared_options import option
from gcs.errors import GcsError, UsageError

if TYPE_CHECKING:
    from gcs.flight.scene.scene_model import Scene
    from gcs.types import JsonObject

PageOption = Annotated[
    bool,
    option("Show it on a page in a browser on this machine, at the address that is printed.", "--page"),
]


TilesOption = Annotated[
    str,
    option(
        "With --page: the address of map tiles, as https://tile.openstreetmap.org/{z}/{x}/{y}.png; the browser asks "
        "there for a map of the ground. Left out: nobody is asked for anything.",
        "--tiles",
        metavar="URL",
    ),
]


@dataclass(frozen=True)
class PageChoices:
    """How a flight is shown on a page: the options --page-address, --page-control, --page-keep and --tiles."""

    address: str = ""
    control: bool = False
    keep: bool = False
    tiles: str = ""


def refuse_tiles(tiles: str, *, page: bool) -> None:
    """Raise UsageError for an address that is none, or without a page."""
    from gcs.page.page_feed import origin_of_tiles

    if tiles and not page:
        raise UsageError("--tiles needs a page", hint="add --page")
    origin_of_tiles(tiles)


def show_page(screen: Screen, scene: Scene, data: JsonObject, tiles: str = "") -> None:
    """Open the page of a scene, print its address, and the result `data` with it; return at Ctrl-C.

    Raises UsageError without NiceGUI, and GcsError for a page that does not start, or ends by itself.
    """
    from gcs.flight.scene.scene_json import scene_json
    from gcs.page.page_feed import PageFeed

    with PageFeed(scene_json(scene), tiles=tiles) as feed:
        screen.say(f"page: {feed.url}")
        screen.say("Ctrl-C ends the page.")
        screen.result({**data, "page": feed.url})
        try:
            feed.wait()
        except KeyboardInterrupt:
            return
    raise GcsError("the page has ended by itself.", hint="run the same command again")
