"""Children of a dashboard's server: without words its pages, else a `sinew` command that ends with the server.

It is apart from what it begins, so that the workers of the pages do not load that again. The stdin of such a command is
a pipe that only the server holds. Where that ends, however the server died, the command gets SIGTERM: a run brings its
bench to the declared safe state, and an emulated bench goes once the run had time for that.
"""

import os
import signal
import sys
import threading
import time

_BENCH_STAYS_S = 10.0


def _end_with_the_server(command: str) -> None:
    os.read(0, 1)
    if command == "emulate":
        time.sleep(_BENCH_STAYS_S)
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__" and sys.argv[1:]:
    from sinew.apps.cli import main as run_command

    threading.Thread(target=_end_with_the_server, args=sys.argv[1:2], daemon=True).start()
    sys.exit(run_command())
elif __name__ == "__main__":
    from sinew.apps.dashboard.page_server import main as serve_pages

    serve_pages()
