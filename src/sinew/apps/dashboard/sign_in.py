"""This is where a viewer shows the token and gets a session.

`sinew serve` prints an address that ends in `#token=...`. What follows the `#` never leaves the browser, so the token
stands in no request line and no log; the page's script posts it once and takes it out of the address.
"""

import json
import time
from collections.abc import Callable

from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from sinew.apps.dashboard.access import COOKIE, Access

__all__ = ["SIGN_IN_PAGE", "WINDOW_S", "WRONG_MOST", "Attempts", "sign_in_routes"]

WRONG_MOST = 10
"""So many wrong tokens are looked at in a window, from all senders together."""

WINDOW_S = 60.0
"""Length of a window [s]; a right token is taken after at most so long."""

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
    """How many wrong tokens came of late; when there were too many, none is looked at until the window is over.

    A generated token cannot be guessed anyway; this is for those that people choose. clock: monotonic [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._wrong, self._began = clock, 0, -WINDOW_S

    def wait_s(self) -> float:
        """Return how long until a token is looked at again [s]; 0 where it is now."""
        left = self._began + WINDOW_S - self._clock()
        return left if self._wrong >= WRONG_MOST and left > 0 else 0.0

    def note_wrong(self) -> None:
        """Count a wrong token; the first one after a window begins the next."""
        if self._clock() >= self._began + WINDOW_S:
            self._wrong, self._began = 0, self._clock()
        self._wrong += 1


def sign_in_routes(access: Access, attempts: Attempts | None = None) -> list[Route]:
    """Return the routes GET /login (a page), POST /login {"token": ...} (sets the cookie) and POST /logout."""
    counted = attempts or Attempts()

    async def sign_in(request: Request) -> Response:
        if (wait_s := counted.wait_s()) > 0:
            sentence = f"too many wrong tokens; try again in {wait_s:.0f} s"
            return _refused(429, sentence, {"Retry-After": str(int(wait_s) + 1)})
        given = _given_token(await request.body())
        if given is None:
            return _refused(400, 'found no token, expected {"token": "..."}')
        if not access.token_is_right(given):
            counted.note_wrong()
            return _refused(401, "this is not the token; copy the one that `sinew serve` printed")
        answer = JSONResponse({"ok": True, "sentence": "signed in"})
        answer.set_cookie(COOKIE, access.session_cookie(), httponly=True, samesite="strict", path="/")
        return answer

    async def sign_out(_request: Request) -> Response:
        answer = JSONResponse({"ok": True, "sentence": "signed out"})
        answer.delete_cookie(COOKIE, httponly=True, samesite="strict", path="/")
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


def _refused(status: int, sentence: str, headers: dict[str, str] | None = None) -> Response:
    return JSONResponse({"ok": False, "sentence": sentence}, status, headers)
