"""The page's process: `python -m gcs.page.page_process`, fed through standard input. It prints its port, then orders.

A view gets the newest picture once it has drawn the one before, so a slow reader keeps nobody waiting.
"""

import asyncio
import json
import os
import socket
import sys
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from functools import partial

import uvicorn
from fastapi import FastAPI, Request, Response
from fastapi.responses import FileResponse, JSONResponse
from nicegui import ui

from gcs.page.formation_view import FormationView
from gcs.page.page_guard import PageGuard
from gcs.page.page_orders import MESSAGE_BYTES, PageOrders
from gcs.page.page_state import PageState, in_thread, read_state
from gcs.page.pipe_frames import PageFrame, write_frame

_STEP_S = 0.1  # between pictures at least
_BUSY_S = 60.0  # a browser that reads a large scene answers nothing meanwhile; after that its page is begun anew
_ADDRESS = "127.0.0.1"


@dataclass
class _Reader:
    events: int  # that it has
    sent: int = -1  # what the state had counted when it was last sent something
    is_ready: bool = True


Out = Callable[[PageFrame, bytes], None]


class PageReaders:
    """The open views, and what each has of the state."""

    def __init__(self, state: PageState, send_out: Out) -> None:
        """`send_out` gets how many browsers show the page, whenever that changes."""
        self._state = state
        self._send_out = send_out
        self._readers: dict[FormationView, _Reader] = {}
        self._count = 0

    def drawn(self, view: FormationView, events: int) -> None:
        """Note that a view has drawn what it got, and how many events it has."""
        reader = self._readers.setdefault(view, _Reader(events))
        reader.events, reader.is_ready = events, True

    async def run(self) -> None:
        """Send what is new until cancelled."""
        while True:
            await asyncio.sleep(_STEP_S)
            self.send()
            self.count()

    def count(self) -> None:
        """Send out how many browsers are connected, if that has changed."""
        count = sum(view.client.has_socket_connection for view in self._readers)
        if count != self._count:
            self._count = count
            with suppress(OSError):  # the flight has ended
                self._send_out(PageFrame.READERS, str(count).encode())

    def send(self) -> None:
        """Send what is new to every view that waits for it."""
        self._readers = {view: reader for view, reader in self._readers.items() if not view.is_deleted}
        for view, reader in self._readers.items():
            if reader.is_ready and reader.sent != self._state.number:
                before, reader.sent, reader.is_ready = reader.sent, self._state.number, False
                view.receive(self._state.since(reader.events, before))


def application(state: PageState, send_out: Out) -> FastAPI:
    """Return the page without its guard. `send_out` writes to the flight."""
    orders = PageOrders(lambda data: send_out(PageFrame.ASK, data))
    state.answer_to(orders.answer)
    readers = PageReaders(state, send_out)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        sending = asyncio.create_task(readers.run())
        yield
        sending.cancel()

    app = FastAPI(lifespan=lifespan, openapi_url=None)

    @app.get("/scene")
    def scene() -> Response:
        return Response(state.whole(), media_type="application/json", headers={"Cache-Control": "no-store"})

    @app.get("/files/{name}")
    def file(name: str) -> Response:
        path = state.files.get(name)
        if path is None:
            return Response(status_code=404)
        return FileResponse(path, filename=name, headers={"Cache-Control": "no-store"})

    @app.post("/orders")
    async def order(request: Request) -> Response:
        body = b""
        async for piece in request.stream():
            body += piece
            if len(body) > MESSAGE_BYTES:
                return Response(status_code=413)
        try:
            return JSONResponse(await orders.ask(body, request.client.host if request.client else ""))
        except ValueError:
            return Response(status_code=400)

    def page() -> None:
        ui.query("body").style("margin: 0")
        ui.query(".nicegui-content").style("padding: 0; gap: 0")
        FormationView(readers.drawn)

    ui.run_with(
        app,
        root=page,
        title="Skein",
        dark=None,
        reconnect_timeout=_BUSY_S,
        gzip_middleware_factory=None,  # all is on one machine
        show_welcome_message=False,
    )
    return app


def serve() -> None:
    """Read the token and the scene, print the port, and serve until the pipe ends."""
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)
        os.nice(5)  # the flight goes first
        pipe = sys.stdin.buffer
        begun = read_state(pipe)
        if begun is None:
            return
        token, state = begun
        address, orders_from_afar, tiles = json.loads(sys.argv[1])
        with socket.create_server((_ADDRESS, 0)) as listening:
            port = int(listening.getsockname()[1])
            guard = PageGuard(
                application(state, partial(write_frame, out)),
                token,
                port,
                address,
                orders_from_afar=orders_from_afar,
                tiles=tiles,
            )
            also = [socket.create_server((address, port))] if address else []
            config = uvicorn.Config(guard, log_level="warning", access_log=False, proxy_headers=False)
            server, at_end = uvicorn.Server(config), threading.Event()
            in_thread(state, pipe, at_end)
            threading.Thread(target=_end_with, args=(at_end,), daemon=True).start()
            out.write(f"{port}\n".encode())
            out.flush()
            server.run(sockets=[listening, *also])


def _end_with(at_end: threading.Event) -> None:
    at_end.wait()
    os._exit(0)


if __name__ == "__main__":
    serve()
