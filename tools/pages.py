"""Pages of the documentation, run as their reader would, and the pictures that they leave.

The ```python blocks of a page, and the lines of its ```console blocks that start with `$ sinew`, are run in one
folder, in order. Other lines of a console block are what the reader sees. `python tools/pages.py docs/pictures` runs
the pages whose pictures stand in the documentation and copies these; `make pictures` calls it.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tools.tree import ROOT

_BLOCK = re.compile(r"^```(python|console)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

# page -> name of a picture that its commands leave -> name in docs/pictures
PICTURES = {
    "docs/tutorials/from-your-csv-to-an-honest-number.md": {"look.png": "csv-look.png", "halves.png": "csv-halves.png"}
}


@dataclass(frozen=True)
class Step:
    """One thing the reader runs: Python text, or one command line."""

    language: str
    text: str


def steps(page: str) -> list[Step]:
    """Return what the reader of a page runs, in the order of reading."""
    found: list[Step] = []
    for language, body in _BLOCK.findall(page):
        if language == "python":
            found.append(Step(language, body))
        else:
            lines = body.replace("\\\n", " ").splitlines()
            found += [Step(language, line[2:]) for line in lines if line.startswith("$ sinew")]
    return found


def run_page(page: str, folder: Path) -> Iterator[tuple[Step, "subprocess.CompletedProcess[str]"]]:
    """Run the steps of a page in a folder, and yield each with what came of it.

    What a line leaves running behind & is ended behind the last step.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "MPLBACKEND": "agg"}
    script: list[str] = []
    begun: list[int] = []
    try:
        for step in steps(page):
            stays = step.language == "console" and step.text.rstrip().endswith("&")
            if step.language == "python":
                # A later block sees the names of the earlier ones, as in one session.
                script.append(step.text)
                command = [sys.executable, "-W", "error", "-c", "\n".join(script)]
            else:
                command = ["bash", "-ceu", step.text]
            with subprocess.Popen(
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=stays,
            ) as process:
                begun += [process.pid] * stays
                out, err = process.communicate()
            yield step, subprocess.CompletedProcess(command, process.returncode, out, err)
    finally:
        for group in begun:
            with suppress(ProcessLookupError):  # it may have ended by itself
                os.killpg(group, signal.SIGTERM)


def draw_pictures(pictures: Path) -> list[Path]:
    """Run the pages with pictures, copy these into a folder, made where absent, and return their paths.

    Raises RuntimeError, with what was said, where a step of a page fails.
    """
    pictures.mkdir(parents=True, exist_ok=True)
    drawn = []
    for name, wanted in PICTURES.items():
        with tempfile.TemporaryDirectory() as folder:
            for step, done in run_page((ROOT / name).read_text(encoding="utf-8"), Path(folder)):
                if done.returncode:
                    raise RuntimeError(f"{name}: {step.text}\n{done.stderr}")
            drawn += [Path(shutil.copyfile(Path(folder) / own, pictures / ours)) for own, ours in wanted.items()]
    return drawn


def main(arguments: list[str]) -> int:
    """Draw into the folder; return the exit status."""
    if len(arguments) != 1:
        print("usage: pages.py PICTURES", file=sys.stderr)
        return 2
    for path in draw_pictures(Path(arguments[0])):
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
