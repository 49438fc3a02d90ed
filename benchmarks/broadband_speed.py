"""Speed and accuracy of the broadband frequency response, beside pyFRF and scipy in one run."""

import importlib.util
import time
import tracemalloc
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from benchmarks.table import Row
from sinew.analysis.broadband import Segmentation, average_pieces, response_of_spectra

SAMPLES, SAMPLE_HZ, LENGTH = 4_200_000, 1000, 4096
Work = Callable[[NDArray[np.float64], NDArray[np.float64]], Any]


def _records() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(0)
    x = rng.standard_normal(SAMPLES)
    y = signal.lfilter(*signal.iirpeak(50.0, 5.0, fs=SAMPLE_HZ), x)
    return x, y + 0.1 * rng.standard_normal(SAMPLES)


def _sinew(x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    response_of_spectra(average_pieces([(x, y)], SAMPLE_HZ, Segmentation(LENGTH, LENGTH // 2)))


def _scipy(x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    signal.csd(x, y, SAMPLE_HZ, nperseg=LENGTH)
    signal.coherence(x, y, SAMPLE_HZ, nperseg=LENGTH)


def _pyfrf(x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    import pyFRF

    frf = pyFRF.FRF(SAMPLE_HZ, x, y, resp_type="d", window="hann", fft_len=LENGTH, nperseg=LENGTH)
    frf.get_H1()
    frf.get_coherence()


def _seconds(work: Work, pair: tuple[NDArray[np.float64], NDArray[np.float64]]) -> float:
    start = time.perf_counter()
    work(*pair)
    return time.perf_counter() - start


def _megabytes(work: Work, pair: tuple[NDArray[np.float64], NDArray[np.float64]]) -> float:
    tracemalloc.start()
    work(*pair)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def rows() -> Iterator[Row]:
    """Yield time (best of seven, in turn) and memory beyond the records of H1 and coherence."""
    pair = _records()
    works: dict[str, Work] = {"scipy": _scipy}
    work = f"H1, coherence of {SAMPLES / 1e6:g} M samples"
    if importlib.util.find_spec("pyFRF") is not None:
        works["pyFRF"] = _pyfrf
    every = {"sinew": _sinew} | works
    rounds = [{name: _seconds(one, pair) for name, one in every.items()} for _ in range(7)]
    best = {name: min(row[name] for row in rounds) for name in every}
    peak = {name: _megabytes(one, pair) for name, one in every.items()}
    for name in works:
        yield Row(work, best["sinew"], name, best[name])
        yield Row(f"{work}: memory", peak["sinew"], name, peak[name], "MB")
    if "pyFRF" not in works:
        yield Row(work, best["sinew"], "pyFRF", None, note="skipped: not installed")
