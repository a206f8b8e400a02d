"""The element of the page that draws a scene: NiceGUI loads its script, which has three.js from `nicegui-scene`.

That module is internal to NiceGUI; `pyproject.toml` pins the version, and a test imports it in a browser.
"""

from collections.abc import Callable

import nicegui.elements.scene  # noqa: F401 (it registers the module of three.js)
from nicegui.element import Element


class FormationView(
    Element, component="formation_view.js", esm={"skein-page": "browser"}, default_classes="skein-view"
):
    """Draws the scene of `/scene`, and asks for a picture whenever it has drawn the last one."""

    def __init__(self, on_drawn: Callable[["FormationView", int], None]) -> None:
        """`on_drawn` gets this view and the number of events that it has."""
        super().__init__()
        self.on("drawn", lambda event: on_drawn(self, int(event.args)))

    def receive(self, update: str) -> None:
        """Send a picture and events, as JSON."""
        self.run_method("receive", update)
