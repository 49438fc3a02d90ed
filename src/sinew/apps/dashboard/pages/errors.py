"""Pages that stand in for others: one that does not exist, one that cannot be made, one that asks for the token."""

from nicegui import app, core, ui
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response

from sinew.apps.dashboard.access import SIGN_IN_PAGE
from sinew.apps.dashboard.pages.frame import Site, framed, plain_page

_MISSING = """<div class="sinew-card"><h1>There is no such page</h1>
<p>The address may be mistyped, or of a run that was moved.</p>
<p><a href="/">To the live page</a></p></div>"""


def add_error_pages(site: Site) -> None:
    """Have pages that do not exist, or break, show what every page shows: the stop, the ways to others, and why."""
    missing = plain_page(site, "No such page", _MISSING)

    async def no_such_page(request: Request, _: Exception) -> Response:
        if "text/html" in request.headers.get("accept", ""):
            return HTMLResponse(missing, 404)
        return JSONResponse({"ok": False, "sentence": "There is no such page."}, 404)

    core.app.add_exception_handler(404, no_such_page)

    def broken() -> None:
        with framed(site, "Not shown", ""), ui.element("div").classes("sinew-card"):
            ui.label("This page cannot be shown").props("role=heading aria-level=1").classes("text-h6")
            ui.label("The dashboard made a mistake; its log says which. The bench goes on as it was.")

    app.on_page_exception(broken)


def sign_in_page(site: Site) -> str:
    """Return the HTML of the page that asks for the token, with the stop, which needs none on the serving machine."""
    form = SIGN_IN_PAGE.partition("<main>")[2].partition("</main>")[0]
    form = form.replace("<form>", '<form id="sinew-sign-in-form">')
    form = form.replace("<button>", '<button class="sinew-button main">')
    script = SIGN_IN_PAGE.partition("<script>")[2].partition("</script>")[0]
    content = f'<div class="sinew-card sinew-sign-in">{form}</div><script>{script}</script>'
    return plain_page(site, "Sign in", content)
