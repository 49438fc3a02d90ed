"""Windows: what needs no port runs without the modules and functions that only POSIX systems have."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

NO_POSIX = """
import sys
# What Python's own library and platformdirs take from POSIX here is loaded first; they have other code for Windows.
import asyncio, concurrent.futures.process, multiprocessing.popen_spawn_posix, multiprocessing.resource_tracker
import multiprocessing.synchronize, pathlib, selectors, shutil, subprocess, tempfile, uuid
import os, platformdirs, select, signal, socket

class Without:
    absent = {"resource", "fcntl", "termios", "tty", "pty", "grp", "pwd", "syslog", "readline"}
    def find_spec(self, name, path=None, target=None):
        if name in self.absent:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

for name in Without.absent:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Without())
for module, names in {
    os: "fork forkpty geteuid getuid getegid getgid O_DIRECTORY O_NOFOLLOW O_NONBLOCK sysconf openpty nice killpg "
        "setsid statvfs mkfifo fchmod fchown WNOHANG sched_setscheduler sched_getaffinity pread getpgid "
        "register_at_fork posix_spawn",
    signal: "SIGKILL SIGHUP SIGALRM SIGUSR1 SIGUSR2 SIGCHLD SIGQUIT SIGPIPE setitimer alarm sigwait",
    socket: "AF_UNIX",
    select: "poll epoll",
}.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
from sinew.apps.cli import main
"""

DECAY = """
import math
with open("decay.csv", "w") as out:
    out.write("time_s,angle_deg\\n")
    for i in range(600):
        t = i / 100
        out.write(f"{t},{10 * math.exp(-0.5 * t) * math.cos(2 * math.pi * 3 * t) + 0.01 * math.sin(997 * i)}\\n")
"""


def without_posix(lines: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run lines in a process that has no POSIX, where `main` is that of the command `sinew`."""
    script = folder / "script.py"
    script.write_text(f'{NO_POSIX}\nif __name__ == "__main__":\n' + "".join(f"    {x}\n" for x in lines.splitlines()))
    return subprocess.run([sys.executable, str(script)], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_commands_without_a_port_run_without_posix_and_all_others_say_wsl(tmp_path: Path) -> None:
    (tmp_path / "make.py").write_text(DECAY)
    subprocess.run([sys.executable, "make.py"], cwd=tmp_path, check=True)
    done = without_posix(
        """
assert main(["--help"]) == 0
assert main(["look", "decay.csv"]) == 0
assert main(["analyse", "decay.csv", "--kind", "ring-down", "--out", "found"]) == 0
assert main(["runs", "."]) == 0
for line in ("run short --port COM3 --out x", "emulate --link x", "stop --port COM3", "doctor --port COM3",
             "track paper --emulate --out x", "serve"):
    print("command", line.split()[0], file=sys.stderr)
    assert main(line.split()) == 2
import sinew.apps.recordings.identify, sinew.apps.recordings.reproduce, sinew.apps.recordings.simulate
import sinew.identify.identified, sinew.predict.predicted, sinew.predict.preview, sinew.bench.preflight
import sinew.paper.report, sinew.twin.simulate, sinew.paper.questions
import sinew.identify.identified, sinew.predict.predicted, sinew.predict.preview, sinew.bench.preflight
import sinew.paper.report, sinew.twin.simulate, sinew.paper.questions
""",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    said = done.stderr.split("command ")[1:]
    assert len(said) == 6
    for lines in said:
        name, sentence, *more = lines.splitlines()
        assert not more
        assert sentence.startswith(f"sinew: sinew {name} ")
        assert "WSL" in sentence
        assert "USB" in sentence


def test_a_pipe_that_takes_no_greek_letters_ends_no_command(tmp_path: Path) -> None:
    """A pipe on Windows has the encoding of its language, as cp1252 without λ."""
    rows = "".join(f"{i / 100},{math.cos(i / 5)}\n" for i in range(100))
    (tmp_path / "swing.csv").write_text(f"t_s,λ\n{rows}", encoding="utf-8")
    asked = [sys.executable, "-c", "from sinew.apps.cli import main; main()", "look", "swing.csv", "--json"]
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252:strict"}
    done = subprocess.run(asked, cwd=tmp_path, capture_output=True, env=environment, check=False)
    assert done.stderr == b""
    assert [one["name"] for one in json.loads(done.stdout)["columns"]] == ["t_s", "λ"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["check", "short"],
        ["simulate", "short", "--out", "x.nc"],
        ["identify", "decay.csv", "--output", "angle_deg", "--excitation", "none", "--model", "linear"],
        ["predict", "paper", "--pretension-mm", "4", "--from-hz", "2.5", "--to-hz", "3.5"],
        ["reproduce", "--plan", "short", "--out", "out"],
    ],
    ids=lambda words: words[0],
)
def test_a_command_that_needs_no_port_runs_without_posix(words: list[str], tmp_path: Path) -> None:
    (tmp_path / "make.py").write_text(DECAY)
    subprocess.run([sys.executable, "make.py"], cwd=tmp_path, check=True)
    done = without_posix(f"assert main({words!r}) == 0", tmp_path)
    assert done.returncode == 0, done.stderr
