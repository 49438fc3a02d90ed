"""A notebook shows a result once, whatever a cell does with it.

The pinned requirements hold no Jupyter kernel, so cells run here in a shell that has what libraries go by in a kernel:
`get_ipython`, a shell of the class `ZMQInteractiveShell`, and `IPython.display.display`. It publishes what a kernel
publishes: what is displayed, what is printed, and the value of a cell's last expression. Where `nbclient` and
`ipykernel` are installed the same cells run in their kernel as well.
"""

import ast
import builtins
import contextlib
import io
import sys
import types
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

MADE = """
import numpy as np, pandas as pd
import sinew as sn
t = np.arange(0, 4, 0.01)
phi = 20 * np.exp(-1.2 * t) * np.cos(2 * np.pi * 3 * t) + np.random.default_rng(1).normal(0, 0.1, t.size)
found = sn.analyse(sn.read(pd.DataFrame({"t": t, "phi": phi}), time="t", response="phi:deg"))
"""


class Output(NamedTuple):
    """One output of a cell: `display`, `stream` or `result`, and its forms by MIME type."""

    kind: str
    data: dict[str, str]


def forms(value: Any) -> dict[str, str]:
    """Return a value as a kernel formats it: text always, HTML where it has some."""
    bundle = getattr(value, "_repr_mimebundle_", None)
    html = getattr(value, "_repr_html_", None)
    found = bundle(include=None, exclude=None) if bundle else {}
    return {"text/plain": repr(value)} | ({"text/html": html()} if html else {}) | found


def stand_in(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[Output]]:
    """Return what runs a cell in a shell that libraries take for a kernel's."""
    published: list[Output] = []
    shell = type("ZMQInteractiveShell", (), {})()
    display: Any = types.ModuleType("IPython.display")
    display.display = lambda *values: published.extend(Output("display", forms(one)) for one in values)
    package: Any = types.ModuleType("IPython")
    package.display = display
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setattr(builtins, "get_ipython", lambda: shell, raising=False)
    names: dict[str, Any] = {}

    def run(cell: str) -> list[Output]:
        published.clear()
        body, last = ast.parse(cell).body, None
        if isinstance(body[-1], ast.Expr) and not cell.rstrip().endswith(";"):
            last = body.pop().value  # type: ignore[attr-defined]
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(ast.Module(body, []), "cell", "exec"), names)
            value = None if last is None else eval(compile(ast.Expression(last), "cell", "eval"), names)
            result = [] if value is None else [Output("result", forms(value))]
        stream = [Output("stream", {"text/plain": printed.getvalue()})] if printed.getvalue() else []
        return [*published, *stream, *result]

    return run


def kernel(_: pytest.MonkeyPatch) -> Callable[[str], list[Output]]:
    """Return what runs a cell, behind all before it, in a kernel of Jupyter."""
    pytest.importorskip("ipykernel", reason="no Jupyter kernel is installed")
    client = pytest.importorskip("nbclient", reason="no nbclient is installed")
    nbformat = pytest.importorskip("nbformat")
    cells: list[str] = []
    kinds = {"display_data": "display", "stream": "stream", "execute_result": "result"}

    def run(cell: str) -> list[Output]:
        cells.append(cell)
        book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(one) for one in cells])
        client.NotebookClient(book, timeout=120, kernel_name="python3").execute()
        return [
            Output(kinds[one.output_type], dict(one.get("data", {"text/plain": one.get("text", "")})))
            for one in book.cells[-1].outputs
        ]

    return run


@pytest.fixture(params=[stand_in, kernel])
def cell(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[Output]]:
    run: Callable[[str], list[Output]] = request.param(monkeypatch)
    run(MADE)
    return run


def test_a_result_that_ends_a_cell_is_shown_once_with_its_tables(cell: Callable[[str], list[Output]]) -> None:
    [shown] = cell("found")
    assert shown.kind == "result"
    assert shown.data["text/html"].count("<table>") == 2  # of the direct fit and of the paper's method
    assert "frequency/Hz" in shown.data["text/plain"]


def test_a_result_that_is_printed_is_text_with_its_tables(cell: Callable[[str], list[Output]]) -> None:
    [shown] = cell("print(found)")
    assert shown.kind == "stream"
    assert "frequency/Hz" in shown.data["text/plain"]


def test_a_result_made_into_text_shows_nothing(cell: Callable[[str], list[Output]]) -> None:
    assert cell("text = str(found) + repr(found) + f'{found}'") == []
