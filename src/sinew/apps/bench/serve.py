"""`sinew serve`: the dashboard, with pages to look at and a port that steers the bench."""

import importlib.util
import json as json_
import re
import signal
import socket
import stat
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import quote

from sinew.apps.console import Json, Seed, flag, option, remark

if TYPE_CHECKING:
    from sinew.apps.dashboard.access import Access
    from sinew.apps.dashboard.steward import Steward

_PAGE_S = 60.0
_LOOK_S = 0.05
_TOKEN = re.compile(r"[!-~]{20,200}")
_ADDRESS = re.compile(r"(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9._-]+):([0-9]{1,5})")
_ANY = ("0.0.0.0", "::")


def serve(
    port_bench: Annotated[str | None, option("PORT", "Serial port of the bench to steer.")] = None,
    emulate: Annotated[bool, flag("--emulate", "Steer an emulated bench, which is begun here.")] = False,
    rig: Annotated[str, option("RIG", "The rig that is emulated, and offered first; a file or a name.")] = "paper",
    runs: Annotated[Path, option("DIR", "Folder of the runs.")] = Path("runs"),
    http: Annotated[str, option("HOST:PORT", "Where pages are served, commands one port on.")] = "127.0.0.1:8080",
    token_file: Annotated[Path | None, option("FILE", "Take the token from a file, not a new one.")] = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Serve the dashboard of a bench to browsers.

    Watch, steer and compare runs, until interrupted. Prints an address that ends in a token: whoever opens it may
    steer. Without --port-bench and --emulate past runs can be looked at and no run begun. Ctrl-C or SIGTERM end it, a
    run first, which goes on later with `sinew run --resume`; a second Ctrl-C does not wait. SIGQUIT (Ctrl-\\) is the
    emergency stop.
    """
    from sinew.measure.errors import SpecError

    if emulate and port_bench is not None:
        raise SpecError("found --emulate and --port-bench, expected one of them at most")
    _refuse_without_packages()
    from sinew.apps.dashboard.steward import Settings, Steward

    access = _access(http, token_file)
    settings = Settings(
        access=access,
        runs=runs,
        bench="emulator" if emulate else "port" if port_bench is not None else None,
        port=port_bench,
        rig=rig,
        seed=seed,
    )
    if not access.is_loopback:
        remark(
            "what goes over the network is not encrypted, and who listens learns the token; better leave --http out "
            f"and use ssh -L {access.port}:127.0.0.1:{access.port} -L {access.steering_port}:127.0.0.1:"
            f"{access.steering_port}"
        )
    steward, over = Steward(settings), threading.Event()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: what was begun is ended

    def end(*_: Any) -> None:
        (steward.hurry if over.is_set() else over).set()

    with steward:
        # A handler runs between any two steps of this thread, so it takes no lock: the order is given by another.
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, end)
        signal.signal(signal.SIGQUIT, lambda *_: threading.Thread(target=_stop_bench, args=(steward,)).start())
        _await_page(steward, over)
        _say_ready(steward, access, as_json=json)
        over.wait()
        if (left := steward.run_left()) is not None:
            remark(f"the run {left} is stopped; Ctrl-C again does not wait")


def _stop_bench(steward: "Steward") -> None:
    remark("emergency stop")
    remark(steward.order_emergency().end.result().sentence)


def _await_page(steward: "Steward", over: threading.Event) -> None:
    end = time.monotonic() + _PAGE_S
    while steward.page_state == "starting" and time.monotonic() < end and not over.is_set():
        over.wait(_LOOK_S)
    if steward.page_state != "up" and not over.is_set():
        remark(f"the page does not come up, the commands do; see {steward.settings.runs / '.bench' / 'page.log'}")


def _say_ready(steward: "Steward", access: "Access", *, as_json: bool) -> None:
    settings = steward.settings
    name = socket.gethostname() if access.host in _ANY else f"[{access.host}]" if ":" in access.host else access.host
    url = f"http://{name}:{access.port}/#token={quote(access.token, safe='')}"
    if as_json:
        bench = {"kind": settings.bench, "port": steward.port, "rig": settings.rig}
        steering = f"http://{name}:{access.steering_port}"
        print(json_.dumps({"url": url, "steering": steering, "runs": str(settings.runs), "bench": bench}))
    else:
        print(url)
    sys.stdout.flush()


def _refuse_without_packages() -> None:
    from sinew.measure.errors import SinewError, how_to_install

    needed = ("nicegui", "starlette", "uvicorn", "itsdangerous")
    lacking = [name for name in needed if importlib.util.find_spec(name) is None]
    if lacking:
        raise SinewError(
            f"found no {lacking[0]}, which the dashboard needs; `make serve` installs it, or: "
            f"{how_to_install('dashboard')}"
        )


def _access(http: str, token_file: Path | None) -> "Access":
    from sinew.apps.dashboard.access import Access, new_token
    from sinew.measure.errors import SpecError

    found = _ADDRESS.fullmatch(http)
    if found is None or not 1 <= int(found[2]) < 65535:
        raise SpecError(f"found --http {http}, expected HOST:PORT such as 127.0.0.1:8080, PORT at most 65534")
    address = found[1].strip("[]")
    own = tuple(_own_names()) if address in _ANY else ()
    token = new_token() if token_file is None else _read_token(token_file)
    return Access(token, address, int(found[2]), own)


def _own_names() -> list[str]:
    """Return the names of this computer, for where all of its addresses are served."""
    name = socket.gethostname()
    with suppress(OSError):
        return [name, *{str(entry[4][0]).partition("%")[0] for entry in socket.getaddrinfo(name, None)}]
    return [name]


def _read_token(file: Path) -> str:
    """Return the token in a file that only its owner can read. Raises FileError."""
    from sinew.measure.errors import FileError

    try:
        mode, token = file.stat().st_mode, file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"cannot read a token from {file}: {error}") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise FileError(f"others can read {file}, expected that only you can; chmod 600 {file}")
    if _TOKEN.fullmatch(token) is None:
        raise FileError(f"found no token in {file}, expected 20 to 200 letters, digits and signs without spaces")
    return token
