"""Server of the pages: a process of its own that looks at the bench and never steers it.

The steward starts it and tells it on stdin, in one line of JSON, what it must know; stdin's end is the steward's, and
then it ends, too.
"""

import asyncio
import json
import os
import sys
import threading
import traceback
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import httpx
import uvicorn
from fastapi import FastAPI, WebSocket
from fastapi.responses import HTMLResponse, JSONResponse, Response, StreamingResponse
from fastapi.staticfiles import StaticFiles
from nicegui import ui

from sinew.apps.dashboard.access import Access, Gate, SignedOut, server_config, sign_in_routes
from sinew.apps.dashboard.hub import Hub, Results, serve_stream
from sinew.apps.dashboard.operators import BENCH, SIGNED_OUT, is_run_name, open_inside, unlinked
from sinew.apps.dashboard.pages.design import add_design_page
from sinew.apps.dashboard.pages.frame import Site, add_error_pages, help_page, sign_in_page
from sinew.apps.dashboard.pages.live import add_live_page
from sinew.apps.dashboard.pages.plan import add_plan_page
from sinew.apps.dashboard.pages.runs import add_runs_pages
from sinew.apps.dashboard.pages.samples import add_samples_page
from sinew.apps.dashboard.work.results import FILES
from sinew.apps.dashboard.worker import Work, Worker
from sinew.measure.errors import SinewError

_STATIC = Path(__file__).with_name("static")
_STATUS_WAIT_S = 2.0
_AGAIN_S = 1.0
_PIECE = 256 * 1024  # bytes


@dataclass(frozen=True)
class Config:
    """What the steward says. token: of this start. http_host, http_port: of the pages. steering_port: of the commands.
    runs: folder of the runs. rig: offered first. bench: "emulator", "port" or None. version: of Sinew. hosts: further
    names under which a proxy brings browsers; own_names: of this computer."""

    token: str
    http_host: str
    http_port: int
    steering_port: int
    runs: Path
    rig: str
    bench: str | None
    version: str
    hosts: tuple[str, ...] = ()
    own_names: tuple[str, ...] = ()

    @property
    def access(self) -> Access:
        """Who may come in; which sessions were ended is what the steward knows, too."""
        signed_out = SignedOut(self.runs / BENCH / SIGNED_OUT)
        return Access(self.token, self.http_host, self.http_port, self.hosts, self.own_names, signed_out)

    @classmethod
    def parse(cls, line: str) -> "Config":
        """Return what one line of JSON says."""
        said = json.loads(line)
        bench = (said.get("bench") or {}).get("kind")
        names = {name: tuple(said.get(name, ())) for name in ("hosts", "own_names")}
        return cls(**{**said, "runs": Path(said["runs"]), "bench": bench, **names})


def make_app(config: Config, work: Work, status: Callable[[], Awaitable[dict[str, Any]]]) -> FastAPI:
    """Return the application. work: the worker. status: asks the steward."""
    access = config.access
    hub = Hub(config.runs, status)
    ours = config.runs, config.rig, config.bench, config.steering_port, access.must_sign_in, config.version
    site = Site(*ours, hub, work, Results(hub, work, config.runs))

    @asynccontextmanager
    async def living(_: FastAPI) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(_kept_going(each)) for each in (hub.run, site.results.run)]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()

    app = FastAPI(lifespan=living, docs_url=None, redoc_url=None, openapi_url=None)
    asking = sign_in_page(site)
    app.router.routes += sign_in_routes(access, asking)
    _add_downloads(app, site)

    @app.websocket("/stream")
    async def stream(socket: WebSocket) -> None:
        await serve_stream(socket, hub)

    app.mount("/sinew", StaticFiles(directory=_STATIC), name="sinew")
    add_live_page(site)
    add_plan_page(site)
    add_runs_pages(site)
    add_samples_page(app, site)
    add_design_page(site)
    helping = help_page(site)
    app.get("/help")(lambda: HTMLResponse(helping))
    add_error_pages(site)
    ui.run_with(
        app, title="Sinew", language="en-US", show_welcome_message=False, dark=None, favicon=_STATIC / "icon.svg"
    )
    app.add_middleware(
        Gate,
        access=access,
        must_sign_in=site.is_locked,
        free=("/login", "/sinew/"),
        sign_in_page=asking,
        steering_port=config.steering_port,
    )
    return app


async def _kept_going(task: Callable[[], Awaitable[None]]) -> None:
    """Run a task that has no end, and begin it again where a fault of our own ends it; the log has the fault."""
    while True:
        try:
            await task()
        except Exception:
            traceback.print_exc()
            await asyncio.sleep(_AGAIN_S)


def _add_downloads(app: FastAPI, site: Site) -> None:
    @app.get("/download/{name}/{kind}")
    async def download(name: str, kind: str) -> Response:
        folder = site.runs / name
        if kind not in FILES or not is_run_name(name) or not folder.is_dir():
            return JSONResponse({"ok": False, "sentence": "There is no such file."}, 404)
        try:
            path = Path(await site.work.call("download", str(unlinked(folder)), kind))
            file = open_inside(site.runs, path)
        except SinewError as trouble:
            return JSONResponse({"ok": False, "sentence": str(trouble)}, 409)
        about = {
            "Content-Disposition": f'attachment; filename="{name}-{FILES[kind]}"',
            "Content-Length": str(os.fstat(file.fileno()).st_size),
        }
        return StreamingResponse(_pieces(file), headers=about, media_type="application/octet-stream")


def _pieces(file: BinaryIO) -> Iterator[bytes]:
    """Yield an open file piece by piece, no more of it than was announced, and close it."""
    with file:
        left = os.fstat(file.fileno()).st_size
        while left > 0 and (piece := file.read(min(left, _PIECE))):
            left -= len(piece)
            yield piece


async def serve(config: Config) -> None:
    """Serve until stdin ends."""
    near = config.access.near
    where = httpx.URL(scheme="http", host=near, port=config.steering_port, path="/status")
    headers = {"authorization": f"Bearer {config.token}", "host": f"127.0.0.1:{config.steering_port}"}
    async with httpx.AsyncClient(headers=headers, timeout=_STATUS_WAIT_S, trust_env=False) as client:

        async def status() -> dict[str, Any]:
            try:
                answer = await client.get(where)
                answer.raise_for_status()
                return dict(answer.json())
            except (httpx.HTTPError, ValueError) as trouble:
                raise OSError(str(trouble)) from trouble

        worker = Worker()
        app = make_app(config, worker, status)
        settings = server_config(
            app, host=config.http_host, port=config.http_port, lifespan="auto", timeout_graceful_shutdown=2
        )
        server = uvicorn.Server(settings)
        try:
            await server.serve()
        finally:
            worker.close()


def main() -> None:
    """Serve as the steward says on stdin."""
    config = Config.parse(sys.stdin.readline())

    def end_with_the_steward() -> None:
        sys.stdin.read()
        os._exit(0)  # nothing here needs to be put away: it only looks

    threading.Thread(target=end_with_the_steward, daemon=True).start()
    asyncio.run(serve(config))
