"""This is where a stretch of data to be identified is held: time, input, output, their units and what they are."""

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sinew.measure.doors import as_numbers, as_seconds
from sinew.measure.errors import RecordingError, SpecError

__all__ = ["FEWEST", "Excitation", "Record", "derivative_order", "make_record"]

Array = NDArray[np.float64]
Excitation = Literal["force", "torque", "base", "lever", "none"]

FEWEST = 16
"""Samples below which nothing is fitted."""
_ORDERS = {"rad/s": 1, "m/s": 1, "V/s": 1, "rad/s2": 2, "m/s2": 2}
_MOTIONS = {"rad/s": "rad", "rad/s2": "rad", "m/s": "m", "m/s2": "m", "V/s": "V"}


@dataclass(frozen=True)
class Record:
    """One stretch of one experiment.

    time_s: strictly increasing, shape (n,). output: shape (n,); input: shape (n,), or None for a free decay.
    excitation: what the input is: a force or torque on the moving part, the motion of its base, the motion of a lever
        on it (relative to it), or none.
    output_unit, input_unit: SI and radians. A rate or acceleration is fitted as such.
    output_delay_s: how much later than the input's the output's stamps are [s].
    group: name of the condition (a pretension, a length) that the stretch was recorded under.
    """

    time_s: Array
    output: Array
    input: Array | None = None
    excitation: Excitation = "none"
    output_unit: str = "1"
    input_unit: str = "1"
    output_delay_s: float = 0.0
    group: str = ""
    notes: tuple[str, ...] = field(default=())

    @property
    def size(self) -> int:
        """Return the number of samples."""
        return self.time_s.size

    @property
    def step_s(self) -> float:
        """Return the median sampling step [s]."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def motion_unit(self) -> str:
        """Return the unit of the motion itself, whose rate or acceleration the output may be."""
        return _MOTIONS.get(self.output_unit, self.output_unit)

    @property
    def input_motion_unit(self) -> str:
        """Return the unit of the input, for a base or lever that of its motion."""
        moved = self.excitation in ("base", "lever")
        return _MOTIONS.get(self.input_unit, self.input_unit) if moved else self.input_unit

    def cut(self, start: int, stop: int) -> "Record":
        """Return the samples start to stop - 1."""
        kept = slice(start, stop)
        given = None if self.input is None else self.input[kept]
        return replace(self, time_s=self.time_s[kept], output=self.output[kept], input=given)


def derivative_order(unit: str) -> int:
    """Return 0 for a motion, 1 for a rate, 2 for an acceleration, by its unit."""
    return _ORDERS.get(unit, 0)


def make_record(
    time_s: ArrayLike,
    output: ArrayLike,
    input: ArrayLike | None = None,  # noqa: A002 - the field's word
    *,
    excitation: Excitation = "none",
    output_unit: str = "1",
    input_unit: str = "1",
    output_delay_s: float = 0.0,
    group: str = "",
) -> Record:
    """Return a record whose arrays are finite, equally long and in time order.

    Raises SpecError where excitation and input do not fit together, RecordingError where the samples are not usable.
    """
    if excitation not in get_args(Excitation):
        raise SpecError(f"excitation is {excitation!r}, expected one of {', '.join(get_args(Excitation))}")
    if excitation == "none" and input is not None:
        raise SpecError(
            "an input is given and the excitation is none; say what the input is (force, torque, base, lever), or "
            "leave the input out to fit a free decay"
        )
    if excitation != "none" and input is None:
        raise SpecError(f"the excitation is {excitation} and no input is given; name its column, or choose none")
    arrays = {"time": time_s, "output": output} | ({} if input is None else {"input": input})
    checked = {
        name: as_seconds(values) if name == "time" else as_numbers(values, name) for name, values in arrays.items()
    }
    for name, values in checked.items():
        if values.ndim != 1 or values.shape != checked["time"].shape:
            raise RecordingError(
                f"time has shape {checked['time'].shape} and {name} {values.shape}; expected one column each"
            )
        if not np.isfinite(values).all():
            raise RecordingError(f"the {name} holds NaN or infinity at sample {int(np.argmin(np.isfinite(values)))}")
    if checked["time"].size < FEWEST:
        raise RecordingError(f"found {checked['time'].size} samples, expected at least {FEWEST}; record longer")
    if np.diff(checked["time"]).min() <= 0:
        raise RecordingError("time does not increase everywhere; sort the record or use its sample index")
    return Record(
        checked["time"],
        checked["output"],
        checked.get("input"),
        excitation,
        output_unit,
        input_unit,
        output_delay_s,
        group,
    )
