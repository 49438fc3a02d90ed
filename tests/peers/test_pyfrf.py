"""The broadband frequency response against pyFRF: the same numbers, less time, less memory."""

import tracemalloc
from typing import Any

import numpy as np
import pytest
from scipy import signal
from tests.unit.broadband_signals import response_of

pyFRF: Any = pytest.importorskip("pyFRF", reason="pyFRF is not installed")  # noqa: N816

SAMPLE_HZ, LENGTH, SAMPLES = 1000, 4096, 4_200_000


def records(size: int):
    rng = np.random.default_rng(0)
    x = rng.standard_normal(size)
    y = signal.lfilter(*signal.iirpeak(50.0, 5.0, fs=SAMPLE_HZ), x)
    return x, y + 0.1 * rng.standard_normal(size)


def ours(x, y):
    return response_of(x, y, SAMPLE_HZ, segment_s=LENGTH / SAMPLE_HZ)


def theirs(x, y):
    frf = pyFRF.FRF(SAMPLE_HZ, x, y, resp_type="d", window="hann", fft_len=LENGTH, nperseg=LENGTH)
    return frf.get_H1().squeeze(), frf.get_coherence().squeeze()


def test_h1_and_coherence_are_those_of_pyfrf_but_for_its_symmetric_window() -> None:
    found, (h1, coherence) = (method(*records(400_000)) for method in (ours, theirs))
    assert np.abs(found.h1 - h1)[2:].max() < 1e-4
    assert np.abs(found.coherence - coherence)[2:].max() < 1e-3


def memory(work, x, y) -> int:
    tracemalloc.start()
    work(x, y)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.slow
def test_it_takes_at_most_a_quarter_of_the_memory_of_pyfrf() -> None:
    x, y = records(SAMPLES)
    assert memory(ours, x, y) < 0.25 * memory(theirs, x, y)
