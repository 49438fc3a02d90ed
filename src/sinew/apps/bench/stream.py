"""`sinew stream`: a run as it goes, over a web socket to Foxglove and PlotJuggler."""

import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from sinew.apps import console
from sinew.apps.console import Json, option
from sinew.measure.errors import FileError

_LOOK_S = 0.05


def stream(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run, under way or over, or its journal.")],
    port: Annotated[
        int, option("N", "Port of the web socket on this machine; 0 takes a free one.", "--ws-port")
    ] = 8765,
    back: Annotated[float, option("S", "Send first what was measured so long before.", "--back-s")] = 10.0,
    until_end: Annotated[
        bool, typer.Option("--until-end/--wait", help="Leave when the run is over, or go on until Ctrl-C.")
    ] = False,
    json: Json = False,
) -> None:
    """Stream a run to Foxglove and PlotJuggler as it goes, over Foxglove's web socket, on this machine only.

    Channels: /sinew/samples, each cycle's readings in SI as the journal has them; /sinew/shown, torsion, lever, tilt
    and currents as the dashboard draws them; /sinew/segment, what is being measured; /sinew/log, what happened. Each
    has a JSON schema. The journal is read beside the run, the bench is never touched, and nothing can be sent back.
    """
    console.checked_number("--ws-port", port, "0 to 65535", low=0, high=65535)
    console.checked_number("--back-s", back, "0 to 86400", low=0, high=86400)
    from sinew.apps.bench.bench_run import JOURNAL

    journal = run / JOURNAL if run.is_dir() else run
    if not journal.is_file():
        raise FileError(f"there is no journal {journal}, expected the folder of a run; start the run first")
    from sinew.apps.dashboard.work.streamed import RunStream

    with RunStream(journal, port, back) as streamed:
        document = {"url": streamed.url, "run": str(run), "topics": streamed.topics}
        told = [
            streamed.url,
            "- Foxglove: open a connection, Foxglove WebSocket; PlotJuggler: stream from Foxglove Bridge",
        ]
        console.print_result(document, told, json=json)
        sys.stdout.flush()
        try:
            while streamed.look() or streamed.is_under_way or not until_end:
                time.sleep(_LOOK_S)
        except KeyboardInterrupt:
            pass
