"""A notebook shows a result once, whatever a cell does with it: cells run in a kernel of Jupyter."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import nbclient
import nbformat
import pytest

pytestmark = pytest.mark.slow  # a kernel takes some seconds to start

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


@pytest.fixture(scope="module")
def kernel() -> Iterator[Callable[[str], list[Output]]]:
    """Yield what runs a cell in a kernel of Jupyter; one kernel runs the cells of all tests."""
    book = nbformat.v4.new_notebook()
    client = nbclient.NotebookClient(book, timeout=120, kernel_name="python3")
    kinds = {"display_data": "display", "stream": "stream", "execute_result": "result"}

    def run(cell: str) -> list[Output]:
        book.cells.append(nbformat.v4.new_code_cell(cell))
        done = client.execute_cell(book.cells[-1], len(book.cells) - 1)
        return [
            Output(kinds[one.output_type], dict(one.get("data", {"text/plain": one.get("text", "")})))
            for one in done.outputs
        ]

    with client.setup_kernel():
        run(MADE)
        yield run


def test_a_result_that_ends_a_cell_is_shown_once_with_its_tables(kernel: Callable[[str], list[Output]]) -> None:
    [shown] = kernel("found")
    assert shown.kind == "result"
    assert shown.data["text/html"].count("<table>") == 2  # of the direct fit and of the paper's method
    assert "frequency/Hz" in shown.data["text/plain"]


def test_the_example_that_uses_results_by_attribute_runs(kernel: Callable[[str], list[Output]]) -> None:
    source = (Path(__file__).parents[2] / "docs/examples/09_results_by_attribute.py").read_text(encoding="utf-8")
    outputs = [output for part in source.split("\n# %%\n") for output in kernel(part)]
    printed = "".join(one.data.get("text/plain", "") for one in outputs)
    assert r"\begin{tabular}" in printed
    assert "frequency_hz_std" in printed


def test_a_result_that_is_printed_is_text_with_its_tables(kernel: Callable[[str], list[Output]]) -> None:
    [shown] = kernel("print(found)")
    assert shown.kind == "stream"
    assert "frequency/Hz" in shown.data["text/plain"]


def test_a_result_made_into_text_shows_nothing(kernel: Callable[[str], list[Output]]) -> None:
    assert kernel("text = str(found) + repr(found) + f'{found}'") == []
