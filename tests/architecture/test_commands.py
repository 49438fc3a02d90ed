"""Commands of benchmarks and campaigns that pages, docstrings and the Makefile name: each is one that still parses."""

import argparse
import contextlib
import importlib
import inspect
import io
import re
import shlex
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn
from unittest import mock

from benchmarks.__main__ import PARTS

ROOT = Path(__file__).resolve().parents[2]
NAMED = re.compile(
    r"`python -m (?P<quoted>(?:benchmarks|campaigns\.)[^`]*)`"
    r"|^(?:\$ |\t\S*| {4})python -m (?P<line>(?:benchmarks|campaigns\.)(?:\S| (?! ))*)",
    re.MULTILINE,
)
"""Within a sentence, where it may go on in the next line; or a line of its own, up to a remark after two spaces."""


class ParsedError(Exception):
    """The parser took the command line: as far as a command goes here."""


def named_in(text: str) -> Iterator[str]:
    """Yield the commands that a text names, as what follows `python -m`."""
    for found in NAMED.finditer(text):
        yield " ".join((found["quoted"] or found["line"]).split())


def named_commands() -> dict[str, str]:
    """Return where each command is named, the last place of several."""
    texts = [ROOT / "Makefile", *ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    texts += [
        path for room in ("benchmarks", "campaigns", "src", "tests", "tools") for path in (ROOT / room).rglob("*.py")
    ]
    history = ROOT / "CHANGELOG.md"  # names commands that have gone
    texts = [path for path in texts if path not in (Path(__file__), history) and "_build" not in path.parts]
    return {
        line: path.relative_to(ROOT).as_posix() for path in texts for line in named_in(path.read_text(encoding="utf-8"))
    }


def only_parse(parser: argparse.ArgumentParser, arguments: Sequence[str] | None = None) -> NoReturn:
    """Parse and do no more: stands for `ArgumentParser.parse_args`."""
    _, rest = parser.parse_known_args(arguments)
    if rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    raise ParsedError


def refusal(line: str) -> str:
    """Return why `python -m LINE` would be refused; empty where its parser takes it."""
    name, *words = shlex.split(line)
    if name == "benchmarks":
        part, *words = words or ["", *words]
        if part not in ("", *PARTS):
            return f"no benchmark {part}"
        if not words:
            return ""
        main = PARTS[part]
    else:
        try:
            module = importlib.import_module(name)
        except ModuleNotFoundError as missing:
            return str(missing)
        if '__name__ == "__main__"' not in inspect.getsource(module):
            return f"{name} is no command"
        main = module.main
    if "parse_args(" not in inspect.getsource(main):
        return "no options are parsed" if words else ""
    said = io.StringIO()
    with (
        mock.patch.object(argparse.ArgumentParser, "parse_args", only_parse),
        mock.patch.object(sys, "argv", [name, *words]),
        contextlib.redirect_stderr(said),
    ):
        try:
            main(*[words] * len(inspect.signature(main).parameters))
        except ParsedError:
            return ""
        except SystemExit:
            return said.getvalue().strip().rpartition("\n")[2]
    return "it ran and parsed nothing"


def test_every_command_that_is_named_is_taken_by_its_parser() -> None:
    refused = {f"{where}: {line}": refusal(line) for line, where in named_commands().items()}
    assert {line: why for line, why in refused.items() if why} == {}
