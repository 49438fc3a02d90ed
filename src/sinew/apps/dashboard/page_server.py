"""Server of the pages: a process of its own that looks at the bench and never steers it.

The steward starts it and tells it on stdin, in one line of JSON, what it must know; stdin's end is the steward's, and
then it ends, too.
"""

import asyncio
import os
import sys
import threading
import traceback
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import uvicorn
from fastapi import FastAPI, WebSocket
from fastapi.responses import FileResponse, HTMLResponse, Response
from fastapi.staticfiles import StaticFiles
from nicegui import ui
from pydantic import BaseModel, ConfigDict
from starlette.background import BackgroundTask

from sinew.apps.dashboard.access import Access, Gate, said, server_config, sign_in_routes
from sinew.apps.dashboard.folders import is_run_name, open_inside, unlinked
from sinew.apps.dashboard.hub import Hub, Results, serve_stream
from sinew.apps.dashboard.pages.design import add_design_page
from sinew.apps.dashboard.pages.frame import Site, add_error_pages, plain_page
from sinew.apps.dashboard.pages.live import add_live_page, add_samples_page
from sinew.apps.dashboard.pages.plan import add_plan_page
from sinew.apps.dashboard.pages.runs import add_runs_pages
from sinew.apps.dashboard.work.results import FILES
from sinew.apps.dashboard.worker import Worker
from sinew.measure.errors import SinewError

_STATIC = Path(__file__).with_name("static")
_STATUS_WAIT_S = 2.0
_AGAIN_S = 1.0


class Config(BaseModel):
    """What the steward says. token, key: of this start, see `Access`. http_host, http_port: of the pages.
    runs: folder of the runs. rig: offered first. bench: "emulator", "port" or None.
    version: of Sinew. own_names: further names of this computer."""

    model_config = ConfigDict(frozen=True)

    token: str
    key: str
    http_host: str
    http_port: int
    runs: Path
    rig: str
    bench: str | None
    version: str
    own_names: tuple[str, ...] = ()


def make_app(config: Config, access: Access, work: Worker, status: Callable[[], Awaitable[dict[str, Any]]]) -> FastAPI:
    """Return the application. access: who may come in. work: the worker. status: asks the steward."""
    hub = Hub(config.runs, status)
    ours = config.runs, config.rig, config.bench, access, config.version
    site = Site(*ours, hub, work, Results(hub, work, config.runs))

    @asynccontextmanager
    async def living(_: FastAPI) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(_run_for_ever(each)) for each in (hub.run, site.results.run)]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()

    app = FastAPI(lifespan=living, docs_url=None, redoc_url=None, openapi_url=None)
    asking = plain_page(site, "Sign in", "sign_in")
    app.router.routes += sign_in_routes(access, asking)
    _add_downloads(app, site)

    @app.websocket("/stream")
    async def stream(socket: WebSocket) -> None:
        await serve_stream(socket, hub)

    app.get("/sinew/{name}.html")(lambda name: said(404, f"There is no page {name}."))  # a template, and no page
    app.mount("/sinew", StaticFiles(directory=_STATIC), name="sinew")
    add_live_page(site)
    add_plan_page(site)
    add_runs_pages(site)
    add_samples_page(app, site)
    add_design_page(site)
    helping = plain_page(site, "Help", "help", "/help")
    app.get("/help")(lambda: HTMLResponse(helping))
    add_error_pages(site)
    ui.run_with(
        app, title="Sinew", language="en-US", show_welcome_message=False, dark=None, favicon=_STATIC / "icon.svg"
    )
    app.add_middleware(Gate, access=access, free=("/login", "/sinew/"), sign_in_page=asking)
    return app


async def _run_for_ever(task: Callable[[], Awaitable[None]]) -> None:
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
            return said(404, "There is no such file.")
        try:
            path = Path(await site.work.call("download", str(unlinked(folder)), kind))
            file = open_inside(site.runs, path)
        except SinewError as trouble:
            return said(409, str(trouble))
        return FileResponse(
            f"/dev/fd/{file.fileno()}",  # the file that was found through no link
            filename=f"{name}-{FILES[kind]}",
            media_type="application/octet-stream",
            stat_result=os.fstat(file.fileno()),
            background=BackgroundTask(file.close),
        )


async def serve(config: Config) -> None:
    """Serve until stdin ends."""
    access = Access(config.token, config.http_host, config.http_port, config.own_names, config.key)
    where = httpx.URL(scheme="http", host=access.near, port=access.steering_port, path="/status")
    headers = {"authorization": f"Bearer {config.token}", "host": f"127.0.0.1:{access.steering_port}"}
    async with httpx.AsyncClient(headers=headers, timeout=_STATUS_WAIT_S, trust_env=False) as client:

        async def status() -> dict[str, Any]:
            try:
                answer = await client.get(where)
                answer.raise_for_status()
                said = dict(answer.json())
                access.signed_out.update(said.pop("signed_out", ()))
                return said
            except (httpx.HTTPError, ValueError) as trouble:
                raise OSError(str(trouble)) from trouble

        worker = Worker()
        app = make_app(config, access, worker, status)
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
    config = Config.model_validate_json(sys.stdin.readline())

    def end_with_the_steward() -> None:
        sys.stdin.read()
        os._exit(0)  # nothing here needs to be put away: it only looks

    threading.Thread(target=end_with_the_steward, daemon=True).start()
    asyncio.run(serve(config))
