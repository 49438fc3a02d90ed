"""Sdist and wheel, tried as who has no clone would: `python tools/try_wheel.py python3.11 python3.12 python3.13`.

Makes the sdist of this tree, the wheel from that sdist, both in dist/, and for each interpreter an empty environment
with the wheel and its dashboard, whose versions the index picks. In it, away from the clone: the command tells its
version, `sinew reproduce` makes the campaign, `sinew serve --emulate` answers its first page, and the gallery's
notebooks run in Jupyter. A line of what each took; ends with 1 where one failed. Needs the package index; takes some
minutes for each interpreter.
"""

import argparse
import os
import re
import select
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("[0-9]*.py"))
MOST_S = 900.0


def build(dist: Path) -> Path:
    """Return the wheel that was made from the sdist that was made from this tree; both are in dist."""
    shutil.rmtree(dist, ignore_errors=True)
    dist.mkdir()
    with tempfile.TemporaryDirectory() as scratch:
        made = "import sys; from setuptools.build_meta import build_sdist; build_sdist(sys.argv[1])"
        run([sys.executable, "-c", made, str(dist)], ROOT)
        (sdist,) = dist.glob("*.tar.gz")
        shutil.unpack_archive(sdist, scratch, filter="data")
        (source,) = Path(scratch).iterdir()
        run([sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(dist), "."], source)
    (wheel,) = dist.glob("*.whl")
    return wheel


def run(command: list[str], folder: Path) -> str:
    """Return what a command prints. Raises RuntimeError with its last words where it fails."""
    clean = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(command, check=False, cwd=folder, env=clean, capture_output=True, text=True, timeout=MOST_S)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[:3])} ended with {done.returncode}: {done.stderr[-2000:]}")
    return done.stdout


def answer_a_page(sinew: Path, folder: Path) -> None:
    """Begin the dashboard with an emulated bench, fetch its first page, and end it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        http = f"127.0.0.1:{free.getsockname()[1]}"
    command = [str(sinew), "serve", "--emulate", "--http", http, "--runs", str(folder / "runs")]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as served:
        try:
            address = said_address(served)
            with urllib.request.urlopen(address, timeout=60) as page:
                if page.status != 200 or "Sinew" not in page.read().decode():
                    raise RuntimeError(f"{address} answered {page.status} without a page of Sinew")
        finally:
            served.terminate()
            served.wait(60)


def said_address(served: "subprocess.Popen[str]") -> str:
    """Return the address that the dashboard prints. Raises RuntimeError where it prints none."""
    assert served.stdout is not None
    text, end = "", time.monotonic() + 120
    while time.monotonic() < end and served.poll() is None:
        if select.select([served.stdout], [], [], 1.0)[0]:
            text += served.stdout.readline()
            if found := re.search(r"http://127\.0\.0\.1:\d+\S*", text):
                return found[0]
    raise RuntimeError(f"sinew serve printed no address: {text[-2000:]}")


def make_notebooks(folder: Path) -> list[Path]:
    """Return the notebooks of the gallery's examples, as its pages offer them."""
    for example in EXAMPLES:
        shutil.copy(example, folder)
    made = [str(folder / example.name) for example in EXAMPLES]
    program = "import sys; from sphinx_gallery.notebook import python_to_jupyter_cli as f; f(sys.argv[1:])"
    run([sys.executable, "-c", program, *made], folder)
    return sorted(folder.glob("*.ipynb"))


def attempt(interpreter: str, wheel: Path) -> dict[str, float | str]:
    """Return what each step took in an empty environment of an interpreter [s], or why it failed."""
    found: dict[str, float | str] = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        python = folder / "lab" / "bin" / "python"
        sinew = python.with_name("sinew")

        def install() -> None:
            run([interpreter, "-m", "venv", str(folder / "lab")], folder)
            run([str(python), "-m", "pip", "install", "--quiet", f"{wheel}[dashboard]"], folder)

        def reproduce() -> None:
            run([str(sinew), "reproduce", "--out", str(folder / "out")], folder)
            missing = [name for name in ("recording.nc", "report.html") if not (folder / "out" / name).is_file()]
            if missing:
                raise RuntimeError(f"sinew reproduce left no {' and no '.join(missing)}")

        def notebooks() -> None:
            run([str(python), "-m", "pip", "install", "--quiet", "nbclient", "ipykernel"], folder)
            for notebook in make_notebooks(folder):
                run([str(python.with_name("jupyter-execute")), str(notebook)], folder)

        steps: dict[str, Callable[[], object]] = {
            "install": install,
            "--version": lambda: run([str(sinew), "--version"], folder),
            "reproduce": reproduce,
            "serve": lambda: answer_a_page(sinew, folder),
            "notebooks": notebooks,
        }
        for name, step in steps.items():
            began = time.monotonic()
            try:
                step()
            except (RuntimeError, OSError, subprocess.TimeoutExpired) as trouble:
                found[name] = str(trouble)
                break
            found[name] = time.monotonic() - began
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("interpreters", nargs="*", default=["python3"], help="Pythons, as commands or paths")
    wheel = build(ROOT / "dist")
    print(f"dist/{wheel.name}, {wheel.stat().st_size / 2**20:.1f} MiB, from its sdist", flush=True)
    is_fine = True
    for interpreter in parser.parse_args().interpreters:
        found = attempt(interpreter, wheel)
        version = run([interpreter, "--version"], ROOT).strip()
        steps = ", ".join(f"{name} {took:.0f} s" for name, took in found.items() if isinstance(took, float))
        print(f"{version}: {steps}", flush=True)
        for name, trouble in found.items():
            if isinstance(trouble, str):
                is_fine = False
                print(f"{version}: {name} FAILED: {trouble}", flush=True)
    return 0 if is_fine else 1


if __name__ == "__main__":
    sys.exit(main())
