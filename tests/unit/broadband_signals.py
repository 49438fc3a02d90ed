"""Joints shaken by noise, chirps and multisines, for the tests of broadband records."""

from typing import Any

import numpy as np
import pandas as pd
from scipy import signal

from sinew.analysis.broadband import FrequencyResponse, Segmentation, average_pieces, response_of_spectra

SAMPLE_HZ = 100.0
Mode = tuple[float, float, float]
"""Natural frequency [Hz], damping ratio, static gain."""


def response_of(
    given: np.ndarray, measured: np.ndarray, sample_hz: float, segment_s: float | None = None, **cut: Any
) -> FrequencyResponse:
    """Return the response of a record; segments: a sixteenth of it, and half of each again, if nothing else is said."""
    length = given.shape[0] // 16 if segment_s is None else round(segment_s * sample_hz)
    hop = max(1, round(length * (1 - cut.pop("overlap", 0.5))))
    return response_of_spectra(average_pieces([(given, measured)], sample_hz, Segmentation(length, hop, **cut)))


def transfer(modes: list[Mode], frequency_hz: np.ndarray) -> np.ndarray:
    s = 2j * np.pi * frequency_hz
    parts = [(gain * w**2, 2 * d * w, w**2) for f, d, gain in modes for w in [2 * np.pi * f]]
    return np.sum([top / (s**2 + damping * s + stiffness) for top, damping, stiffness in parts], axis=0)


def noise(modes: list[Mode], seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return _filtered(modes, rng.standard_normal(round(seconds * SAMPLE_HZ)))


def chirp(modes: list[Mode], seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(round(seconds * SAMPLE_HZ)) / SAMPLE_HZ
    return _filtered(modes, signal.chirp(t, 0.5, seconds, 12.0))


def multisine(modes: list[Mode], seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the settled response to lines every 1/8 Hz from 0.5 to 12 Hz."""
    t, lines = np.arange(round(seconds * SAMPLE_HZ)) / SAMPLE_HZ, np.arange(4, 97) / 8.0
    waves = np.exp(1j * (2 * np.pi * t[:, None] * lines + rng.uniform(0, 2 * np.pi, lines.size))) / 7
    return waves.sum(axis=1).real, (waves @ transfer(modes, lines)).real


def _filtered(modes: list[Mode], drive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    response = np.zeros(drive.size)
    for f, damping, gain in modes:
        w = 2 * np.pi * f
        top, bottom, _ = signal.cont2discrete(([gain * w**2], [1, 2 * damping * w, w**2]), 1 / SAMPLE_HZ, "foh")
        response += signal.lfilter(top.ravel(), bottom, drive)
    return drive, response


def shaken(kind: Any, modes: list[Mode], seed: int, seconds: float = 120.0, share: float = 0.02) -> pd.DataFrame:
    """Return columns t [s], u (the drive) and phi [deg], the latter with `share` of its deviation as noise."""
    rng = np.random.default_rng(seed)
    drive, response = kind(modes, seconds, rng)
    response = response + share * response.std() * rng.standard_normal(response.size)
    return pd.DataFrame({"t": np.arange(drive.size) / SAMPLE_HZ, "u": drive, "phi": response})
