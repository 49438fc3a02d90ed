"""Why two ring-downs of one silicone beam differ: creep, amplitude, another mode, or the beam itself.

Own weight, 52 g and 101 g at the tip, two repeats each (Dragon Skin 10, motion capture). Creep is modelled throughout.
Repeats under own weight agree within 6 %. Those with 52 g differ in damping and frequency at one and the same
amplitude, so that neither creep nor amplitude explains it: the beam was in another state. Of those with 101 g, the
second is no slowly changing sine: it tells its damping to a tenth at best, and holds the first in its band.
"""

from functools import cache

import numpy as np
import pytest
from tests.paper.test_real_ring_downs import DATA, beam, beam_record

from sinew.analysis.decay.modes import ModalDecay, fit_modes
from sinew.identify.oscillator.backbone import Backbone, fit_backbone

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="real recordings are not beside this repository")


@cache
def backbone(name: str) -> Backbone:
    return fit_backbone(*beam_record(name), free_from_s=beam(name).start_s, creeps=True, harmonics=False)


@cache
def two_modes(name: str) -> ModalDecay:
    return fit_modes(*beam_record(name), free_from_s=beam(name).start_s, modes=2, creeps=True)


def at(found: Backbone, amplitude_mm, values):
    return np.interp(-np.asarray(amplitude_mm) / 1e3, -found.amplitude, values)


def damping_differences(load: str, amplitude_mm) -> tuple[np.ndarray, np.ndarray]:
    """Return the damping of repeat a less that of b at each amplitude: relative, and in standard deviations."""
    a, b = (backbone(f"beam_{load}_V2_{repeat}") for repeat in "ab")
    values = [at(found, amplitude_mm, found.damping_ratio) for found in (a, b)]
    stds = [at(found, amplitude_mm, found.damping_ratio_std) for found in (a, b)]
    off = values[0] - values[1]
    return off / np.mean(values, axis=0), off / np.hypot(*stds)


@pytest.mark.slow
def test_repeats_under_own_weight_have_one_damping_within_six_percent_at_every_amplitude() -> None:
    assert np.abs(damping_differences("gravity", [3.6, 2.4, 1.6, 1.0, 0.7, 0.5])[0]).max() < 0.06


@pytest.mark.slow
def test_repeats_with_52_g_differ_in_damping_by_more_than_seven_percent_at_one_and_the_same_amplitude() -> None:
    assert damping_differences("load52", [5.0, 3.4, 2.2, 1.5])[0].min() > 0.07


@pytest.mark.slow
def test_the_difference_of_the_repeats_with_52_g_is_more_than_the_noise_explains() -> None:
    assert damping_differences("load52", [5.0, 3.4, 2.2, 1.5])[1].min() > 2.5


def test_repeats_with_52_g_differ_in_frequency_at_one_and_the_same_amplitude() -> None:
    a, b = backbone("beam_load52_V2_a"), backbone("beam_load52_V2_b")
    off = at(a, [5.0, 3.4], a.frequency_hz) - at(b, [5.0, 3.4], b.frequency_hz)
    std = np.hypot(at(a, [5.0, 3.4], a.frequency_std_hz), at(b, [5.0, 3.4], b.frequency_std_hz))
    assert (off / std).min() > 3.0


@pytest.mark.slow
def test_repeats_with_101_g_cannot_be_told_apart() -> None:
    assert np.abs(damping_differences("load101", [11.0, 7.5, 5.0, 3.4, 2.2])[1]).max() < 2.5


def test_the_second_repeat_with_101_g_says_its_damping_to_a_tenth_at_best() -> None:
    found = backbone("beam_load101_V2_b")
    relative = at(found, [11.0, 7.5, 5.0, 3.4], found.damping_ratio_std / found.damping_ratio)
    assert relative.min() > 0.1


def test_the_damping_with_a_load_rises_as_the_swing_dies() -> None:
    for name in ("beam_load52_V2_a", "beam_load52_V2_b", "beam_load101_V2_a"):
        found = backbone(name)
        large, small = at(found, [6.0, 1.0], found.damping_ratio)
        assert small > 1.2 * large


def test_two_close_modes_with_52_g_have_one_frequency_in_both_repeats() -> None:
    a, b = (
        sorted(m.natural_frequency_hz.value for m in two_modes(f"beam_load52_V2_{repeat}").modes) for repeat in "ab"
    )
    assert (a[0], a[1]) == (pytest.approx(b[0], abs=0.03), pytest.approx(b[1], abs=0.08))
