"""This is where it is said what a joint is to be designed for: a gait, an inertia, and the room that there is."""

from dataclasses import dataclass

from sinew.measure.errors import SpecError
from sinew.predict.joints.loads import Torso

__all__ = ["DesignTarget"]


_FASTEST_HZ = 100.0


@dataclass(frozen=True)
class DesignTarget:
    """What a joint has to do and may not exceed.

    band_hz: lowest and highest stride frequency [Hz], at which it has to resonate. yaw_deg: amplitude of the torsion
    there. inertia: of what sits on it, about its axis, without the lever that drives it [kg m²].
    diameter, length: of the largest envelope [m]; guides stand out by `GUIDE` beyond their circle.
    lever_share: largest inertia of the lever as a share of `inertia`. least_damping: smallest D [1] at both ends: a
    stride that comes 2 D beside the last one still lies within the half-power width. wander: share of its frequency
    that the rig's repeatability of pretension may move the resonance by. torso: mass and place of what sits on it;
    None leaves its weight out.
    Raises SpecError where a number cannot be meant.
    """

    band_hz: tuple[float, float]
    yaw_deg: float
    inertia: float
    diameter: float = 0.20
    length: float = 0.25
    lever_share: float = 0.15
    least_damping: float = 0.01
    wander: float = 0.01
    torso: Torso | None = None

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not 0 < low < high <= _FASTEST_HZ:
            raise SpecError(
                f"found a stride band of {low:g} to {high:g} Hz, expected 0 < lowest < highest, as 0.7:1.1, up to "
                f"{_FASTEST_HZ:g} Hz"
            )
        if not 0 < self.yaw_deg <= 45:
            raise SpecError(f"found a yaw of {self.yaw_deg:g}°, expected an amplitude above 0 and up to 45°")
        if not 1e-4 <= self.inertia <= 10:
            raise SpecError(f"found an inertia of {self.inertia:g} kg m², expected 0.0001 to 10")
        if not (0.03 <= self.diameter <= 1 and 0.03 <= self.length <= 2):
            raise SpecError(
                f"found an envelope of {1e3 * self.diameter:g} by {1e3 * self.length:g} mm, expected a diameter of 30 "
                "to 1000 mm and a length of 30 to 2000 mm"
            )
        if self.torso is not None and not (0 < self.torso.mass <= 500 and 0 <= self.torso.centre <= 3):
            raise SpecError(
                f"found a torso of {self.torso.mass:g} kg with its centre {1e3 * self.torso.centre:g} mm above the "
                "joint, expected above 0 and up to 500 kg, and 0 to 3000 mm"
            )
        if not 0.005 <= self.lever_share <= 1:
            raise SpecError(f"found a lever of {self.lever_share:g} of the inertia, expected a share of 0.005 to 1")
