"""`sinew export --to foxglove`: a run as it goes, over a web socket to Foxglove and PlotJuggler."""

import sys
import time
from pathlib import Path

from sinew.apps import console
from sinew.measure.errors import FileError

_LOOK_S = 0.05


def stream_run(run: Path, port: int, back: float, *, until_end: bool, json: bool) -> None:
    """Stream a run to Foxglove and PlotJuggler as it goes, until Ctrl-C, or until its end.

    run: its folder or its journal. port: of the web socket on this machine, 0 for a free one. back: sent first is what
    was measured so long before [s]. Channels: /sinew/samples, each cycle's readings in SI as the journal has them;
    /sinew/shown, torsion, lever, tilt and currents as the dashboard draws them; /sinew/segment, what is being measured;
    /sinew/log, what happened. Each has a JSON schema.
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
