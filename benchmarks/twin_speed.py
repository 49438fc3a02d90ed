"""Speed of the twin against scipy's `solve_ivp` and against `mujoco.rollout`, in one run.

All three swing the paper's joint through the same groups on all cores. `solve_ivp` integrates the twin's own
equations, compiled, with its tolerance set so that its amplitudes are about as accurate as the twin's; MuJoCo
integrates a leaner model, that of `sinew model --no-sway` without memory and gear's friction, at the twin's step.
"""

import importlib.util
import os
import time
from collections.abc import Iterator

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.table import Row, best_of
from sinew.mechanics.joint import rate, state_at_rest
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.modes import ModesRequest
from sinew.predict.multibody import joint_bodies, write_mjcf
from sinew.solve.march import STEPS_PER_SAMPLE
from sinew.solve.programs import use_all_cores
from sinew.twin.simulate import lane_parameters, simulate_tracks

SAMPLE_HZ = 200.0
SECONDS = 5.0
_WORK = "the twin, a simulated second of a lane"


def _groups(count: int) -> list[Group]:
    frequency = np.linspace(1.5, 6.0, count)
    return [Group("steady", float(i % 13), float(f), 20.0, 0, SECONDS - 1, 1.0) for i, f in enumerate(frequency)]


def _amplitude(torsion: NDArray[np.float64]) -> float:
    """Return the half range over the last second [rad]."""
    return float(np.ptp(torsion[-int(SAMPLE_HZ) :]) / 2)


def _scipy_lane(group: Group, rig: RigSpec, rtol: float) -> tuple[float, float]:
    """Return (seconds, amplitude) of one lane with scipy's adaptive Runge-Kutta 5(4)."""
    lanes, shortening = lane_parameters([group], rig)
    p = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), lanes)
    flat, unravel = jax.flatten_util.ravel_pytree(state_at_rest(jnp.asarray(shortening[0]), p))
    slope = jax.jit(lambda t, y: jax.flatten_util.ravel_pytree(rate(t, unravel(y), p))[0])
    slope(0.0, flat).block_until_ready()
    start = time.perf_counter()
    solution = solve_ivp(
        lambda t, y: np.asarray(slope(t, y)),
        (0, SECONDS),
        np.asarray(flat),
        "RK45",
        rtol=rtol,
        atol=rtol * 1e-2,
        t_eval=np.arange(int(SECONDS * SAMPLE_HZ)) / SAMPLE_HZ,
    )
    return time.perf_counter() - start, _amplitude(solution.y[0])


def _against_scipy(rig: RigSpec, twin_cost: float) -> Iterator[Row]:
    groups = [Group("steady", 6.0, 3.6, 20.0, 0, SECONDS - 1, 1.0)]
    lanes = lane_parameters(groups, rig)
    fine = _amplitude(simulate_tracks(lanes, groups, SAMPLE_HZ, steps=32)[0].torsion)
    ours = abs(_amplitude(simulate_tracks(lanes, groups, SAMPLE_HZ)[0].torsion) / fine - 1)
    for rtol in (1e-3, 1e-4, 1e-5, 1e-6):
        seconds, amplitude = _scipy_lane(groups[0], rig, rtol)
        error = abs(amplitude / fine - 1)
        if error <= max(ours, 1e-4):
            break
    note = f"errors of the amplitude {ours:.1e} and {error:.1e}; wanted: at least 50 times"
    yield Row(_WORK, 1e3 * twin_cost, f"solve_ivp RK45, rtol {rtol:g}", 1e3 * seconds / SECONDS, "ms", note)


def _rollout(rig: RigSpec, groups: list[Group], step_s: float, integrator: str) -> tuple[float, NDArray[np.float64]]:
    """Return (seconds, half range of each lane's torsion over the last second) of `mujoco.rollout` on all cores."""
    import mujoco
    from mujoco import rollout

    steps, threads = round(SECONDS / step_s), os.cpu_count() or 1
    # Without the silicone's memory, whose light masses no explicit integrator takes at such a step.
    asked = {g.pretension_mm: ModesRequest((g.pretension_mm,), (0.0,)) for g in groups}
    lean = {p: joint_bodies(rig, one, sway=False)._replace(memory=()) for p, one in asked.items()}
    models = [mujoco.MjModel.from_xml_string(write_mjcf(lean[g.pretension_mm], [])) for g in groups]
    for model in models:
        model.opt.timestep = step_s
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.zeros((len(groups), mujoco.mj_stateSize(models[0], full)))
    time_s = np.arange(steps) * step_s
    control = np.zeros((len(groups), steps, models[0].nu))
    control[..., -1] = [np.radians(20) * np.sin(2 * np.pi * g.frequency_hz * time_s) for g in groups]
    datas = [mujoco.MjData(models[0]) for _ in range(threads)]
    seconds, (states, _) = best_of(2, lambda: rollout.rollout(models, datas, start, control, nstep=steps))
    place = 1 + models[0].jnt_qposadr[models[0].joint("twist0").id]  # after the time
    torsion = states[:, -round(1 / step_s) :, place]
    return seconds, np.ptp(torsion, axis=1) / 2


def _against_mujoco(rig: RigSpec, twin_cost: float) -> Iterator[Row]:
    if importlib.util.find_spec("mujoco") is None:
        yield Row(_WORK, 1e3 * twin_cost, "MuJoCo", None, "ms", "skipped: not installed")
        return
    step_s = 1 / SAMPLE_HZ / STEPS_PER_SAMPLE
    groups = _groups(26)
    _, fine = _rollout(rig, groups, step_s / 8, "RK4")
    for label, integrator, step in (
        ("RK4, the twin's step", "RK4", step_s),
        ("implicitfast, the twin's step", "IMPLICITFAST", step_s),
        ("implicitfast, a quarter of it", "IMPLICITFAST", step_s / 4),
    ):
        seconds, amplitude = _rollout(rig, groups, step, integrator)
        note = f"error of the amplitude {np.max(np.abs(amplitude / fine - 1)):.1e}"
        yield Row(_WORK, 1e3 * twin_cost, f"MuJoCo, {label}", 1e3 * seconds / (SECONDS * len(groups)), "ms", note)


def rows() -> Iterator[Row]:
    """Yield the twin's cost per simulated second beside its peers'; of MuJoCo's stable ones at least 10 times."""
    use_all_cores()
    rig = load_rig("paper")
    groups = _groups(1040)
    lanes = lane_parameters(groups, rig)
    simulate_tracks(lanes, groups, SAMPLE_HZ)
    seconds, _ = best_of(3, lambda: simulate_tracks(lanes, groups, SAMPLE_HZ))
    cost = seconds / (SECONDS * len(groups))
    yield from _against_scipy(rig, cost)
    yield from _against_mujoco(rig, cost)
