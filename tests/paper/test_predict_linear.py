"""The predicted joint where it is linear, where it is not, and where its motion has corners.

Small motions against the linear joint, multipliers against the time integration's monodromy matrix on a stable and an
unstable motion, backbones against the curves, slack tendons and dry friction against time integration.
"""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sinew.measure.arrays import Array
from sinew.mechanics.joint import State, rate
from sinew.mechanics.silicone import BRANCHES
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.joint import RESOLUTION, free_lever, joint_problem
from sinew.predict.linear import equivalent_of_rig, linear_joints
from sinew.predict.oscillator import Oscillator, oscillator_problem, resolution_of
from sinew.solve.backbone import follow_backbones
from sinew.solve.balance import channels, embedded, grid, motion, slices, unknowns
from sinew.solve.branch import Branch
from sinew.solve.continuation import follow
from sinew.solve.curves import predict
from sinew.solve.examination import evaluate, maps_of, rows_of
from sinew.solve.march import integrate, runge_kutta

pytestmark = pytest.mark.slow
BAND_HZ = (1.0, 6.0)
PRETENSIONS = [0.0, 6.0, 12.0]


def curves(command_deg: float) -> tuple[Branch, ...]:
    problem = joint_problem(load_rig("paper"), PRETENSIONS, command_deg, BAND_HZ)
    return predict(problem, BAND_HZ, RESOLUTION).branches


@cache
def departures(command_deg: float) -> Array:
    """Return how far balance and linear joint are apart, largest share, (pretension, ratio): torsion over command,
    lever over command, torsion over lever."""
    rig, rows = load_rig("paper"), []
    for branch, joint in zip(curves(command_deg), linear_joints(rig, PRETENSIONS, gear="creeping"), strict=True):
        command = -1j * np.radians(command_deg)
        drive, lever = joint.drive.response(branch.frequency_hz), joint.lever.response(branch.frequency_hz)
        pairs = (
            (branch.phasor / command, drive[:, 0, 0]),
            (branch.drive / command, drive[:, 1, 0]),
            (branch.phasor / branch.drive, lever[:, 0, 0]),
        )
        rows.append([float(np.abs(ours / linear - 1).max()) for ours, linear in pairs])
    return np.array(rows)


def test_a_command_of_a_thousandth_of_a_degree_meets_the_linear_joint_with_every_effect_on() -> None:
    # Guide friction is quadratic at small angles, so the departure is about the torsion over the presliding angle.
    assert departures(1e-3).max() < 5e-4


def test_what_parts_a_small_motion_from_the_linear_joint_falls_with_its_amplitude() -> None:
    assert departures(1e-4) == pytest.approx(0.1 * departures(1e-3), rel=0.1)


def test_backbones_begin_where_the_linear_joint_lags_by_90_degrees_and_end_on_the_curve() -> None:
    rig = load_rig("paper")
    found = follow_backbones(joint_problem(rig, PRETENSIONS, 20.0, BAND_HZ), BAND_HZ, RESOLUTION)
    for one, joint, branch in zip(found, linear_joints(rig, PRETENSIONS), curves(20.0), strict=True):
        near = one.curve.frequency_hz[0] + np.linspace(-0.02, 0.02, 4001)
        linear = near[np.argmin(np.abs(joint.lever.response(near)[:, 0, 0].real))]
        assert one.curve.complete
        assert branch.phase_90 is not None
        assert one.curve.frequency_hz[0] == pytest.approx(linear, rel=1e-4)
        assert one.curve.frequency_hz[-1] == pytest.approx(branch.phase_90.frequency_hz, rel=2e-5)
        assert one.curve.amplitude[-1] == pytest.approx(branch.phase_90.amplitude, rel=2e-4)


def test_at_phase_resonance_the_equivalent_spring_is_inertia_times_frequency_squared() -> None:
    rig = load_rig("paper")
    (found,) = follow_backbones(joint_problem(rig, [4.0], 10.0, BAND_HZ), BAND_HZ, RESOLUTION)
    inertia = rig.inertia.head.value + rig.inertia.lever.value
    stiffness = equivalent_of_rig(found.curve, found.curve.drive, rig).stiffness_n_m_rad
    assert stiffness == pytest.approx(inertia * (2 * np.pi * found.curve.frequency_hz) ** 2, rel=1e-6)


class Motion(NamedTuple):
    """A steady motion of a joint: its frequency, the twin's state at τ = 0, and the multipliers by Floquet."""

    frequency_hz: float
    state: State
    multipliers: NDArray[np.complex128]


def state_of(x: Array, lane: object, harmonics: int) -> State:
    """Return the twin's state at τ = 0 from the channels of a motion; the gyroscope is at rest."""
    q, omega = motion(jnp.asarray(x), lane, free_lever(1), harmonics)  # type: ignore[arg-type]
    u = channels(q, omega, free_lever(1), grid(free_lever(1), RESOLUTION.sizes[0][1]), harmonics).values[:, 0]
    n, zero = BRANCHES, jnp.zeros(())
    lever = 2 * (2 + n)
    memory, axial = tuple(u[2 : 2 + n]), tuple(u[4 + n : lever])
    return State(u[0], u[1], u[2 + n], u[3 + n], u[lever], u[lever + 1], memory, axial, zero, zero, (u[lever + 2],))


def motions(rig: RigSpec, command_deg: float, pick: str) -> tuple[Motion, object]:
    """Return a motion of the curve at no pretension, refined: its `largest`, or the middle one of its `unstable`."""
    problem = joint_problem(rig, [0.0], command_deg, BAND_HZ)
    size, fine = RESOLUTION.sizes[0]
    scale = np.asarray(problem.lane.scale)[0]
    start = np.zeros((1, unknowns(free_lever(1), size.harmonics) + 1))
    start[0, slices(free_lever(1), size.harmonics)[1].start] = problem.rest[0, 1] / scale[1]
    window = 2 * np.pi * np.array(BAND_HZ) / np.asarray(problem.lane.omega)[0]
    start[0, -1] = window[0]
    curve = follow(start, problem.lane, window, np.int64(512), RESOLUTION.stride, equations=free_lever(1), size=size)
    points = np.asarray(curve.points)[0, : int(curve.number[0])]
    x = np.zeros((len(points), unknowns(free_lever(1), fine.harmonics) + 1))
    x[:, embedded(free_lever(1), size.harmonics, fine.harmonics)] = points
    lanes = rows_of(problem.lane, np.zeros(len(points), dtype=int))
    for _ in range(3):  # at their frequency
        seen = evaluate(x, lanes, free_lever(1), fine)
        x[:, :-1] -= np.linalg.solve(seen.slope[:, :, :-1], seen.left[:, :, None])[:, :, 0]
    roots = np.linalg.eigvals(maps_of(x, lanes, free_lever(1), fine)) ** 2
    if pick == "largest":
        index = int(np.argmax(np.abs(x[:, 0]) + np.abs(x[:, 1])))
    else:
        back = np.flatnonzero(np.abs(roots).max(axis=1) > 1)
        index = int(back[back.size // 2])
    lane = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[0]), problem.lane)
    frequency = float(x[index, -1] * lane.omega / (2 * np.pi))
    return Motion(frequency, state_of(x[index], lane, fine.harmonics), roots[index]), lane.p


def monodromy(found: Motion, p: object) -> tuple[Array, float]:
    """Return (monodromy matrix of the twin's time integration over the periodic motion next to a predicted one, how far
    the predicted state was from it in shares of it). The periodic motion is found by shooting."""
    flat, unravel = jax.flatten_util.ravel_pytree(found.state)
    steps = 1500
    step_s = jnp.asarray(1 / found.frequency_hz / steps)
    driven = p._replace(omega=jnp.asarray(2 * np.pi * found.frequency_hz))  # type: ignore[attr-defined]

    @jax.jit
    def period(y: jax.Array) -> jax.Array:
        def body(n: int, now: State) -> State:
            return runge_kutta(lambda at, y: rate(at, y, driven), n * step_s, now, step_s)

        return jax.flatten_util.ravel_pytree(jax.lax.fori_loop(0, steps, body, unravel(y)))[0]

    slope, y = jax.jit(jax.jacfwd(period)), np.asarray(flat)
    for _ in range(6):
        y = y + np.linalg.solve(np.eye(y.size) - np.asarray(slope(y)), np.asarray(period(y)) - y)
    assert np.asarray(period(y)) == pytest.approx(y, abs=1e-9)
    apart, whole = (unravel(jnp.asarray(off)) for off in (np.asarray(flat) - y, y))
    zero = jnp.zeros(())
    of = [jax.flatten_util.ravel_pytree(one._replace(gyro=zero, gyro_rate=zero))[0] for one in (apart, whole)]
    return np.asarray(slope(y)), float(jnp.linalg.norm(of[0]) / jnp.linalg.norm(of[1]))


def sizable(roots: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the multipliers above 0.05, the upper ones of pairs, by size."""
    kept = roots[(np.abs(roots) > 0.05) & (roots.imag > -1e-9)]
    return kept[np.argsort(np.abs(kept))]


UNDAMPED = {"tendons.guide_friction": 0.0, "silicone.loss_factor": 0.02, "drive.friction": 0.0}


@pytest.mark.parametrize(
    ("rig", "command_deg", "pick"),
    [(load_rig("paper"), 20.0, "largest"), (load_rig("paper").with_values(UNDAMPED), 15.0, "unstable")],
    ids=["a stable motion with every effect", "an unstable motion between folds"],
)
def test_every_multiplier_is_that_of_the_time_integrations_monodromy(
    rig: RigSpec, command_deg: float, pick: str
) -> None:
    found, p = motions(rig, command_deg, pick)
    matrix, apart = monodromy(found, p)
    ours, theirs = sizable(found.multipliers), sizable(np.linalg.eigvals(matrix))
    assert apart < 5e-3
    assert (np.abs(ours[-1]) > 1) == (pick == "unstable")
    assert ours == pytest.approx(theirs, rel=1e-2)


def slack_rig(contact_n: float) -> RigSpec:
    """Return the paper's rig with a tension at first contact below what its bounds allow."""
    data = load_rig("paper").model_dump()
    data["tendons"]["first_contact_tension"].update(value=contact_n, bounds=(0, 30))
    return RigSpec.model_validate(data)


class Settled(NamedTuple):
    """What time integration settles to: half of peak to peak, lag of the fundamental behind the lever's, and the share
    of time without tension."""

    amplitude: float
    phase: float
    slack: float


def settled(rig: RigSpec, command_deg: float, frequency_hz: float) -> Settled:
    sample_hz, problem = 400.0, joint_problem(rig, [0.0], command_deg, BAND_HZ)
    p = problem.lane.p._replace(omega=np.full(1, 2 * np.pi * frequency_hz))
    track = integrate(p, problem.rest[:, 1], [6400], 1 / sample_hz, steps=8)[0]
    count, orders = round(4 * sample_hz / frequency_hz), np.arange(1, 30)
    turns = np.outer(np.arange(6400)[-count:] / sample_hz, 2 * np.pi * frequency_hz * orders)
    basis = np.concatenate([np.ones((count, 1)), np.cos(turns), np.sin(turns)], axis=1)
    waves = [np.linalg.lstsq(basis, row[-count:], rcond=None)[0][1:] for row in (track.torsion, track.lever)]
    torsion, lever = (c[: orders.size] - 1j * c[orders.size :] for c in waves)
    fine = np.exp(1j * np.outer(np.linspace(0, 2 * np.pi, 2000), orders))
    size = float(np.ptp((fine @ torsion).real) / 2)
    return Settled(size, float(np.angle(lever[0] / torsion[0])), float(np.mean(track.stretch[0, -count:] < 0)))


def test_tendons_that_go_slack_near_resonance_leave_the_curve_whole_and_right() -> None:
    rig = slack_rig(0.5)
    branch = predict(joint_problem(rig, [0.0], 25.0, BAND_HZ), BAND_HZ, RESOLUTION).branches[0]
    assert branch.complete
    assert "left out" not in branch.message
    for wanted in (2.78, 2.98, 3.17):
        i = int(np.argmin(np.abs(branch.frequency_hz - wanted)))
        found = settled(rig, 25.0, float(branch.frequency_hz[i]))
        assert found.slack > 0.1
        assert branch.amplitude[i] == pytest.approx(found.amplitude, rel=5e-3)
        assert abs(np.degrees(np.angle(np.exp(1j * (branch.phase[i] - found.phase))))) < 0.5


def test_a_head_that_bounces_on_slack_tendons_is_left_out_with_a_sentence_and_the_rest_is_right() -> None:
    rig = slack_rig(0.0)
    branch = predict(joint_problem(rig, [0.0], 20.0, BAND_HZ), BAND_HZ, RESOLUTION).branches[0]
    assert "could not be refined" in branch.message
    assert "tendons that go slack" in branch.message
    stable = np.flatnonzero(branch.stable)
    for i in stable[np.linspace(1, stable.size - 2, 5).astype(int)]:
        found = settled(rig, 20.0, float(branch.frequency_hz[i]))
        assert found.slack > 0.1
        assert branch.amplitude[i] == pytest.approx(found.amplitude, rel=5e-3)
        assert abs(np.degrees(np.angle(np.exp(1j * (branch.phase[i] - found.phase))))) < 0.5


@pytest.mark.parametrize(("share", "tolerance"), [(0.3, 5e-3), (0.6, 2e-2)])
def test_dry_friction_is_that_of_a_time_integration_with_a_sharp_turn(share: float, tolerance: float) -> None:
    # The larger friction holds the oscillator for a part of each period, away from resonance.
    one = Oscillator(12.74e-3, 3.0, 0.05, coulomb=share * 0.45, torque=0.45)
    branch = predict(oscillator_problem([one], (1.5, 5.0)), (1.5, 5.0), resolution_of([one])).branches[0]
    assert branch.complete
    damping, natural = 2 * 0.05 * np.sqrt(one.stiffness * one.inertia), 2 * np.pi * 3.0
    speed = 1e-3 * natural * (1 - share) * 0.45 / one.stiffness
    largest = float(branch.amplitude.max())
    for wanted in (2.0, 2.9, 3.3, 4.5):
        i = int(np.argmin(np.abs(branch.frequency_hz - wanted)))
        omega = 2 * np.pi * float(branch.frequency_hz[i])

        def rates(t: float, y: Array, omega: float = omega) -> list[float]:
            push = 0.45 * np.sin(omega * t) - damping * y[1] - one.stiffness * y[0]
            return [y[1], (push - one.coulomb * np.tanh(y[1] / speed)) / one.inertia]

        last = np.linspace(29, 30, 400) * 2 * np.pi / omega
        path = solve_ivp(rates, (0, last[-1]), [0.0, 0.0], "LSODA", t_eval=last, rtol=1e-7, atol=1e-9)
        assert branch.amplitude[i] == pytest.approx(np.ptp(path.y[0]) / 2, abs=tolerance * largest)
