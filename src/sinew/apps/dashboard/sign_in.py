"""Signing in and out: a viewer shows the token and gets a session, or ends it.

`sinew serve` prints an address that ends in `#token=...`. What follows the `#` never leaves the browser, so the token
stands in no request line and no log; the page's script posts it once and takes it out of the address.
"""

import json
import time
from collections import OrderedDict
from collections.abc import Callable

from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from sinew.apps.dashboard.access import Access

__all__ = ["SIGN_IN_PAGE", "WINDOW_S", "WRONG_MOST", "Attempts", "sign_in_routes"]

WRONG_MOST = 10
"""So many wrong tokens of one source are answered as such in a window."""

WINDOW_S = 60.0
"""Length of a window [s]."""

_MOST_SOURCES = 1024

SIGN_IN_PAGE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Sinew: sign in</title>
<style>
:root { color-scheme: light dark; font: 1rem/1.5 system-ui, sans-serif; }
main { max-width: 26rem; margin: 12vh auto; padding: 0 1rem; }
label, input, button { display: block; width: 100%; box-sizing: border-box; font: inherit; }
input, button { margin: .25rem 0 1rem; padding: .6rem; }
</style>
</head>
<body>
<main>
<h1>Sinew</h1>
<p>Sign in with the token that <code>sinew serve</code> printed.</p>
<form>
<label for="token">Token</label>
<input id="token" type="password" autocomplete="off" required>
<button>Sign in</button>
<p id="said" role="status"></p>
</form>
</main>
<script>
const form = document.querySelector("form"), said = document.getElementById("said");
async function signIn(token) {
  try {
    const answer = await fetch("/login", {
      method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify({token}),
    });
    if (answer.ok) location.replace(location.pathname === "/login" ? "/" : location.pathname);
    else said.textContent = (await answer.json()).sentence;
  } catch { said.textContent = "the dashboard does not answer; is sinew serve running?"; }
}
form.addEventListener("submit", event => {
  event.preventDefault();
  signIn(document.getElementById("token").value.trim());
});
const given = new URLSearchParams(location.hash.slice(1)).get("token");
if (given) { history.replaceState(null, "", location.pathname); signIn(given); }
</script>
</body>
</html>
"""
"""HTML of a page that asks for the token, or takes it from the address's fragment."""


class Attempts:
    """How many wrong tokens came of late from each source. clock: monotonic [s].

    This keeps guessing from being cheap and from filling the day. It is no lock: a right token is always taken, or
    whoever sends wrong ones could keep its owner from the stop. One of 20 characters and more is not found by trying.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._wrong: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def wait_s(self, source: str) -> float:
        """Return how long a source waits until a wrong token of it is answered as such again [s]; 0 where it is now."""
        wrong, began = self._wrong.get(source, (0, 0.0))
        left = began + WINDOW_S - self._clock()
        return left if wrong >= WRONG_MOST and left > 0 else 0.0

    def note_wrong(self, source: str) -> None:
        """Count a wrong token; the first one after a window begins the next. The oldest source is forgotten."""
        now = self._clock()
        wrong, began = self._wrong.pop(source, (0, now))
        self._wrong[source] = (wrong + 1, began) if now < began + WINDOW_S else (1, now)
        if len(self._wrong) > _MOST_SOURCES:
            self._wrong.popitem(last=False)


def sign_in_routes(access: Access, attempts: Attempts | None = None) -> list[Route]:
    """Return the routes GET /login (a page), POST /login {"token": ...} (sets the cookie) and POST /logout.

    A session that is signed out is over for both servers, wherever its cookie was copied to.
    """
    counted = attempts or Attempts()

    async def sign_in(request: Request) -> Response:
        given = _given_token(await request.body())
        if given is None:
            return _refused(400, 'found no token, expected {"token": "..."}')
        if not access.token_is_right(given):
            return refuse_wrong(request)
        answer = JSONResponse({"ok": True, "sentence": "signed in"})
        access.set_cookie(answer, request, access.new_session())
        return answer

    def refuse_wrong(request: Request) -> Response:
        source = access.source(request)
        if not access.is_at_machine(request):
            if (wait_s := counted.wait_s(source)) > 0:
                sentence = f"too many wrong tokens; try again in {wait_s:.0f} s"
                return _refused(429, sentence, {"Retry-After": str(int(wait_s) + 1)})
            counted.note_wrong(source)
        return _refused(401, "this is not the token; copy the one that `sinew serve` printed")

    async def sign_out(request: Request) -> Response:
        answer = JSONResponse({"ok": True, "sentence": "signed out"})
        try:
            access.end_session(request)
        except OSError as trouble:
            sentence = f"signed out here, but the bench was not told ({trouble.strerror}); end `sinew serve` to be sure"
            answer = _refused(500, sentence)
        access.set_cookie(answer, request, "")
        return answer

    async def page(_request: Request) -> Response:
        return HTMLResponse(SIGN_IN_PAGE)

    return [
        Route("/login", page, methods=["GET"]),
        Route("/login", sign_in, methods=["POST"]),
        Route("/logout", sign_out, methods=["POST"]),
    ]


def _given_token(body: bytes) -> str | None:
    try:
        told = json.loads(body)
    except (ValueError, RecursionError):
        return None
    given = told.get("token") if isinstance(told, dict) else None
    return given if isinstance(given, str) else None


def _refused(status: int, sentence: str, headers: dict[str, str] | None = None) -> JSONResponse:
    return JSONResponse({"ok": False, "sentence": sentence}, status, headers)
