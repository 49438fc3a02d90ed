"""This is where commands to the bench arrive: an application of a few lines, on a port of its own, beside the page.

The page's server draws, streams and computes, and may be busy. Nothing of that happens here: what may block runs in
threads, and the emergency stop in one that is kept for it.
"""

import asyncio
import json
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Annotated, Any, Literal, Protocol

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.applications import Starlette
from starlette.middleware.cors import CORSMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from sinew.apps.dashboard.access import Access, Gate
from sinew.apps.dashboard.emergency import Outcome
from sinew.apps.dashboard.operators import Operators, Ticket
from sinew.apps.dashboard.refusal import RefusedError

__all__ = ["TICKET_HEADER", "Helm", "SteeringCommand", "steering_app"]

TICKET_HEADER = "X-Sinew-Ticket"
"""Header in which a page says who it is when it asks for the status; the query `ticket` does, too."""

_Text = Annotated[str, Field(max_length=256 * 1024)]


class SteeringCommand(BaseModel):
    """What a page says, and in which order. number: greater than that of its last command."""

    model_config = ConfigDict(frozen=True, strict=True)

    ticket: Annotated[str, Field(max_length=64)]
    number: Annotated[int, Field(ge=1, le=2**53)]
    command: Literal["take", "give", "start", "continue", "pause", "resume", "hold", "release", "stop"]
    plan: _Text | None = None
    rig: _Text | None = None
    name: _Text | None = None


class Helm(Protocol):
    """What steers: the steward. Everything but `emergency` may block."""

    @property
    def operators(self) -> Operators:
        """Return who looks on and who operates."""

    def status(self, asking: str | None) -> dict[str, Any]:
        """Return what is going on, as seen by a ticket; never blocks."""

    def start(self, name: str, plan: str, rig: str) -> str:
        """Begin a run. Raises RefusedError."""

    def go_on(self, name: str) -> str:
        """Go on with a run that ended early. Raises RefusedError."""

    def tell(self, command: str) -> str:
        """Tell the run something. Raises RefusedError."""

    def emergency(self) -> Awaitable[Outcome]:
        """Bring the bench to rest at once."""


def steering_app(access: Access, helm: Helm) -> ASGIApp:
    """Return the application of the steering port: POST /ticket, POST /leave, POST /command, GET /status.

    Answers are JSON, {"ok", "sentence", ...} and a status of 4xx where a command is not carried out.
    """
    desk = _Desk(access, helm)
    routes = [
        Route("/ticket", _signed_in(access, desk.ticket), methods=["POST"]),
        Route("/leave", _signed_in(access, desk.leave), methods=["POST"]),
        Route("/command", desk.command, methods=["POST"]),
        Route("/status", desk.status, methods=["GET"]),
    ]
    gate = Gate(
        Starlette(routes=routes), access, must_sign_in=access.must_sign_in, free=("/command",), urgent=("/command",)
    )
    return CORSMiddleware(
        gate,
        allow_origins=access.origins(),
        allow_credentials=True,
        allow_methods=["GET", "POST"],
        allow_headers=["Content-Type", "Authorization", TICKET_HEADER],
    )


class _Desk:
    """What is behind the routes."""

    def __init__(self, access: Access, helm: Helm) -> None:
        self._access, self._helm = access, helm

    async def ticket(self, _request: Request) -> Response:
        ticket = self._helm.operators.give_ticket()
        return JSONResponse({"ok": True, "ticket": ticket.id, "number": 0, "name": ticket.name})

    async def leave(self, request: Request) -> Response:
        """Hear that a page is closed; a browser says so in passing, and waits for no answer."""
        try:
            ticket = json.loads(await request.body())["ticket"]
        except (ValueError, RecursionError, KeyError, TypeError):
            return _said(400, "found no ticket, expected that of the page that is left")
        self._helm.operators.leave(str(ticket))
        return _said(200, "the page is left")

    async def status(self, request: Request) -> Response:
        asking = request.headers.get(TICKET_HEADER) or request.query_params.get("ticket")
        told = self._helm.status(asking)
        may = {"signed_in": self._access.is_signed_in(request), "may_stop": self._access.may_stop(request)}
        answer = JSONResponse(told | may)
        self._access.keep_session(answer, request)
        return answer

    async def command(self, request: Request) -> Response:
        told: object = None
        if self._access.may_stop(request):
            with suppress(ValueError, RecursionError):
                told = json.loads(await request.body())
            if isinstance(told, dict) and told.get("command") == "emergency":
                # Whoever is signed in or sits here may stop the bench, however old the page: twice harms nobody.
                outcome = await asyncio.shield(self._helm.emergency())
                return _said(200 if outcome.is_safe else 409, outcome.sentence, took_ms=1e3 * outcome.took)
        if not self._access.is_signed_in(request):
            return _nobody()
        if not isinstance(told, dict):
            return _said(400, "found no JSON object, expected a command")
        try:
            command = SteeringCommand.model_validate(told)
            ticket = self._helm.operators.admit(command.ticket, command.number)
            return _said(200, await self._carry_out(command, ticket))
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(map(str, first["loc"])) or "the command"
            return _said(422, f"{where}: {first['msg']}")
        except RefusedError as refusal:
            return _said(refusal.status, str(refusal), **refusal.more)

    async def _carry_out(self, command: SteeringCommand, ticket: Ticket) -> str:
        operators = self._helm.operators
        if command.command == "take":
            return operators.take(ticket)
        if command.command == "give":
            return operators.give(ticket)
        operators.require_operator(ticket)
        if command.command == "continue":
            if command.name is None:
                raise RefusedError(422, "found no name; expected that of the run to go on with")
            return await asyncio.to_thread(self._helm.go_on, command.name)
        if command.command != "start":
            return await asyncio.to_thread(self._helm.tell, command.command)
        if command.plan is None or command.rig is None or command.name is None:
            raise RefusedError(422, "found a start without plan, rig or name; expected all three")
        return await asyncio.to_thread(self._helm.start, command.name, command.plan, command.rig)


def _signed_in(access: Access, answer: Callable[[Request], Awaitable[Response]]) -> Callable[..., Awaitable[Response]]:
    """Return an endpoint that only those get to who are signed in, also where looking takes no token."""

    async def endpoint(request: Request) -> Response:
        if not access.is_signed_in(request):
            return _nobody()
        return await answer(request)

    return endpoint


def _nobody() -> Response:
    return _said(401, "nobody is signed in; sign in with the token that `sinew serve` printed")


def _said(status: int, sentence: str, **more: object) -> Response:
    return JSONResponse({"ok": status < 400, "sentence": sentence, **more}, status)
