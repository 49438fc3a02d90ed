"""A run that is none: it listens where `sinew run` does and moves nothing. Its plan's name says how it behaves.

Run as a script with the run's folder.
"""

import json
import os
import signal
import socket
import sys
import tempfile
import time
from pathlib import Path

OBEDIENT, DEAF, LOUT, SLOW = "obedient", "deaf", "lout", "slow"
"""Does what it is told; listens and never answers; never listens and takes no signal but the last; rests only later."""

RELUCTANT, FORLORN = "reluctant", "forlorn"
"""Has its motors stand at the third emergency that it hears; never."""


def main(folder: Path) -> None:
    name = (folder / "plan.toml").read_text()
    if LOUT in name:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        (folder / "began").touch()
        time.sleep(600)
    with tempfile.TemporaryDirectory() as place, socket.socket(socket.AF_UNIX) as door:
        door.bind(f"{place}/control")
        door.listen()
        (folder / "control").write_text(f"{place}/control")
        state, emergencies = "running", 0
        while state in ("running", "paused", "stopping"):
            line, _ = door.accept()
            with line:
                command = json.loads(line.makefile("rb").readline())["command"]
                if DEAF in name:
                    time.sleep(600)
                state = {"pause": "running" if SLOW in name else "paused", "resume": "running", "status": state}.get(
                    command, "ended"
                )
                at = {"state": state, "pid": os.getpid(), "pause_asked": command == "pause"}
                emergencies += command == "emergency"
                is_late = command == "emergency" and (FORLORN in name or (RELUCTANT in name and emergencies < 3))
                if is_late:
                    at["state"] = state = "stopping"
                told = {"ok": not is_late, "sentence": f"{command} is done", "state": at}
                line.sendall(json.dumps(told).encode() + b"\n")
        (folder / "control").unlink()
    print(json.dumps({"ended": f"{command} was asked for", "left": "nothing moves"}, indent=2))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
