"""Known answers through the whole path: linear joint on the twin, sensors, recording, analysis, interval."""

from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.analysis import analyse_recording
from sinew.plan.plan import Plan, Pretension, RingDown, Sweep
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.twin.effects import Effects
from sinew.twin.simulate import lane_parameters, record_tracks, simulate_tracks

LINEAR = Effects().without("tendons", "silicone_loss", "guide_friction", "axial_motion", "repeatability")


@dataclass(frozen=True)
class Joint:
    """A linear joint I φ̈ + d φ̇ + k φ = -I_l θ̈ made of the paper's silicone and inertia."""

    damping_ratio: float

    @property
    def rig(self) -> RigSpec:
        paper = load_rig("paper")
        viscous = 2 * self.damping_ratio * np.sqrt(self.stiffness * self.inertia)
        return paper.with_values({"silicone.viscous": viscous})

    @property
    def stiffness(self) -> float:
        paper = load_rig("paper")
        return paper.silicone.torsional_rigidity.value / paper.silicone.length.value

    @property
    def inertia(self) -> float:
        paper = load_rig("paper")
        return paper.inertia.head.value + paper.inertia.lever.value

    @property
    def natural_hz(self) -> float:
        return float(np.sqrt(self.stiffness / self.inertia) / (2 * np.pi))

    @property
    def peak_hz(self) -> float:
        """Frequency of the largest gain by measured drive: ω0 / sqrt(1 - 2 D²), for Ω² excitation."""
        return self.natural_hz / np.sqrt(1 - 2 * self.damping_ratio**2)

    def response(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return torsion over drive, φ/θ."""
        omega = 2 * np.pi * frequency_hz
        viscous = self.rig.silicone.viscous.value
        return (
            self.rig.inertia.lever.value * omega**2 / (self.stiffness - self.inertia * omega**2 + 1j * viscous * omega)
        )


def _plan(joint: Joint, *, repeats: int, ring_downs: int = 0) -> Plan:
    # the transient is down to 5e-5 when the record starts
    settle_s = 10 / (joint.damping_ratio * 2 * np.pi * joint.natural_hz)
    around = joint.natural_hz * np.array([0.6, 0.75, 0.85, 0.92, 0.96, 1.0, 1.04, 1.08, 1.15, 1.25, 1.4, 1.8])
    ring_down = RingDown(
        frequency_hz=(joint.natural_hz, joint.natural_hz),
        amplitude_deg=10,
        drive_s=settle_s,
        repeats=max(ring_downs, 1),
    )
    return Plan(
        name="linear joint",
        pretension=Pretension(pretension_mm=(0.0,)),
        sweep=Sweep(frequency_hz=tuple(around), amplitude_deg=10, settle_s=settle_s, repeats=repeats),
        ring_down=ring_down if ring_downs else None,
    )


def _recordings(joint: Joint, plan: Plan, seeds: range) -> "list[xr.Dataset]":
    """Return recordings of the same true motion with different noise."""
    groups = plan.groups()
    lanes = lane_parameters(groups, joint.rig, effects=LINEAR)
    tracks = simulate_tracks(lanes, groups, plan.sample_hz)
    return [
        record_tracks(tracks, lanes, plan, joint.rig, effects=LINEAR, rng=np.random.default_rng(seed)) for seed in seeds
    ]


@pytest.mark.parametrize("damping_ratio", [0.03, 0.05, 0.1, 0.17, 0.25])
def test_gain_and_phase_of_a_linear_joint_come_back_through_the_sensors(damping_ratio: float) -> None:
    joint = Joint(damping_ratio)
    results = analyse_recording(_recordings(joint, _plan(joint, repeats=1), range(1))[0], joint.rig)
    truth = joint.response(results["frequency_hz"].values)
    gain = results["gain_measured_drive"].values[0, :, 0]
    lag = results["phase_lag_rad"].values[0, :, 0]
    np.testing.assert_allclose(gain, np.abs(truth), rtol=3e-3)
    np.testing.assert_allclose(np.degrees(lag), -np.degrees(np.angle(truth)), atol=0.3)


@pytest.mark.parametrize("damping_ratio", [0.03, 0.1, 0.25])
def test_damping_ratio_of_a_linear_joint_comes_back_from_its_ring_down(damping_ratio: float) -> None:
    joint = Joint(damping_ratio)
    free = LINEAR.without("drive_dynamics")
    plan = _plan(joint, repeats=1, ring_downs=1)
    groups = plan.groups()
    lanes = lane_parameters(groups, joint.rig, effects=free)
    tracks = simulate_tracks(lanes, groups, plan.sample_hz)
    recording = record_tracks(tracks, lanes, plan, joint.rig, effects=free, rng=np.random.default_rng(3))
    results = analyse_recording(recording, joint.rig)
    assert float(results["damping_ratio"][0, 0]) == pytest.approx(damping_ratio, rel=5e-3)
    undamped = np.hypot(results["decay_frequency_hz"][0, 0] * 2 * np.pi, results["decay_rate_per_s"][0, 0])
    assert float(undamped) == pytest.approx(2 * np.pi * joint.natural_hz, rel=1e-3)
    assert bool(results["exponential"][0, 0])
