"""The steps of a linear law, taken together, are those of the loop."""

import numpy as np
import pytest

from sinew.identify.oscillator.model import get_model
from sinew.identify.oscillator.record import Record, Scales, grid_of, make_record
from sinew.identify.oscillator.track import LINEAR, LOCAL, PLACE, traced_slopes, traced_track, track, track_slopes
from sinew.solve.programs import configure

OMEGA = 9.0
SIZES = {"stiffness": 1.1, "damping": 0.2, "gain": 0.4, "start": 0.3, "start_rate": -0.2, "offset": 0.1, "drift": 0.05}
NUMBERS = np.array([SIZES.get(name, -1.0 if name == "creep_time" else 0.0) for name in LOCAL])


def uneven(excitation: str) -> Record:
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.005, 0.03, 217))
    return make_record(time, np.sin(time), rng.standard_normal(217), excitation=excitation)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("excitation", ["force", "base"])
def test_the_motion_and_its_derivatives_are_those_of_the_loop_to_twelve_digits(order: int, excitation: str) -> None:
    configure()
    grid, _ = grid_of(uneven(excitation), Scales(OMEGA, 1.0, 1.0), "absolute", LINEAR)
    free = np.array([PLACE[name] for name in (*SIZES, "creep_time")])
    directions = np.eye(len(LOCAL))[free]
    compiled = get_model("linear").law.compiled
    together, one_by_one = track(NUMBERS, grid, LINEAR, order), traced_track(NUMBERS, grid, compiled, order)
    assert together == pytest.approx(np.asarray(one_by_one), abs=1e-12 * np.abs(together).max())
    slopes = track_slopes(NUMBERS, free, grid, LINEAR, order)
    expected = np.asarray(traced_slopes(NUMBERS, directions, grid, compiled, order))
    assert slopes == pytest.approx(expected, abs=1e-12 * np.abs(slopes).max())


def test_the_first_steps_alone_are_the_same() -> None:
    configure()
    grid, samples = grid_of(uneven("force"), Scales(OMEGA, 1.0, 1.0), "relative", LINEAR)
    some = int(samples[60])
    assert track(NUMBERS, grid, LINEAR, 0, some) == pytest.approx(
        track(NUMBERS, grid, LINEAR, 0)[: some + 1], abs=1e-13
    )
