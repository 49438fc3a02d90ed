"""Speed of the twin against scipy's `solve_ivp` and against `mujoco.rollout`, in one run.

All three swing the paper's joint through the same groups on all cores. `solve_ivp` integrates the twin's own
equations, compiled, with its tolerance set so that its amplitudes are about as accurate as the twin's; MuJoCo
integrates a leaner model, that of `sinew model --no-sway` without memory and gear's friction, at the twin's step.
"""

import importlib.util
import os
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sinew.mechanics.joint import rate, state_at_rest
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.modes import Asked
from sinew.predict.multibody import joint_bodies, write_mjcf
from sinew.solve.march import STEPS_PER_SAMPLE
from sinew.solve.programs import use_all_cores
from sinew.twin.simulate import lane_parameters, simulate_tracks

SAMPLE_HZ = 200.0
SECONDS = 5.0
_STABLE = 0.1  # of the amplitude: MuJoCo begins a motion anew that runs away


def _groups(count: int) -> list[Group]:
    frequency = np.linspace(1.5, 6.0, count)
    return [Group("steady", float(i % 13), float(f), 20.0, 0, SECONDS - 1, 1.0) for i, f in enumerate(frequency)]


def _best_of(runs: int, work: Callable[[], Any]) -> tuple[float, Any]:
    best, result = np.inf, None
    for _ in range(runs):
        start = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - start)
    return best, result


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


def _against_scipy(rig: RigSpec, twin_cost: float) -> None:
    groups = [Group("steady", 6.0, 3.6, 20.0, 0, SECONDS - 1, 1.0)]
    lanes = lane_parameters(groups, rig)
    fine = _amplitude(simulate_tracks(lanes, groups, SAMPLE_HZ, steps=32)[0].torsion)
    ours = abs(_amplitude(simulate_tracks(lanes, groups, SAMPLE_HZ)[0].torsion) / fine - 1)
    for rtol in (1e-3, 1e-4, 1e-5, 1e-6):
        seconds, amplitude = _scipy_lane(groups[0], rig, rtol)
        error = abs(amplitude / fine - 1)
        if error <= max(ours, 1e-4):
            break
    cost = seconds / SECONDS
    print(f"  solve_ivp RK45 rtol {rtol:g}   {cost * 1e3:9.2f} ms per simulated second, amplitude error {error:.1e}")
    print(f"  twin                     {twin_cost * 1e3:9.2f} ms per simulated second, amplitude error {ours:.1e}")
    print(f"  ratio {cost / twin_cost:.0f} (wanted: at least 50)")


def _rollout(rig: RigSpec, groups: list[Group], step_s: float, integrator: str) -> tuple[float, NDArray[np.float64]]:
    """Return (seconds, half range of each lane's torsion over the last second) of `mujoco.rollout` on all cores."""
    import mujoco
    from mujoco import rollout

    steps, threads = round(SECONDS / step_s), os.cpu_count() or 1
    # Without the silicone's memory, whose light masses no explicit integrator takes at such a step.
    asked = {g.pretension_mm: Asked((g.pretension_mm,), (0.0,)) for g in groups}
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
    seconds, (states, _) = _best_of(2, lambda: rollout.rollout(models, datas, start, control, nstep=steps))
    place = 1 + models[0].jnt_qposadr[models[0].joint("twist0").id]  # after the time
    torsion = states[:, -round(1 / step_s) :, place]
    return seconds, np.ptp(torsion, axis=1) / 2


def _against_mujoco(rig: RigSpec, twin_cost: float) -> None:
    if importlib.util.find_spec("mujoco") is None:
        print("  MuJoCo is not installed: skipped")
        return
    step_s = 1 / SAMPLE_HZ / STEPS_PER_SAMPLE
    groups = _groups(26)
    _, fine = _rollout(rig, groups, step_s / 8, "RK4")
    ratios = []
    for label, integrator, step in (
        ("RK4, the twin's step", "RK4", step_s),
        ("implicitfast, the twin's step", "IMPLICITFAST", step_s),
        ("implicitfast, a quarter of it", "IMPLICITFAST", step_s / 4),
    ):
        seconds, amplitude = _rollout(rig, groups, step, integrator)
        cost = seconds / (SECONDS * len(groups))
        error = np.max(np.abs(amplitude / fine - 1))
        ratios.append(cost / twin_cost if step == step_s and error < _STABLE else np.inf)
        print(
            f"  {label:31} {cost * 1e3:6.2f} ms per simulated second, error {error:.1e}, ratio {cost / twin_cost:.1f}"
        )
    print(f"  {min(ratios):.1f} times MuJoCo's cheapest that runs stably at the same step (wanted: at least 10)")


def main() -> None:
    """Print the twin's cost per simulated second beside its peers'."""
    use_all_cores()
    rig = load_rig("paper")
    groups = _groups(1040)
    lanes = lane_parameters(groups, rig)
    start = time.perf_counter()
    simulate_tracks(lanes, groups, SAMPLE_HZ)
    first = time.perf_counter() - start
    seconds, _ = _best_of(3, lambda: simulate_tracks(lanes, groups, SAMPLE_HZ))
    cost = seconds / (SECONDS * len(groups))
    print(f"twin: {len(groups)} lanes of {SECONDS:g} s on {os.cpu_count()} cores")
    print(f"  first call {first:.2f} s, then {seconds:.2f} s, {cost * 1e3:.2f} ms per simulated second")
    print("against scipy.integrate.solve_ivp, same equations, one lane after the other")
    _against_scipy(rig, cost)
    print(f"against mujoco.rollout on {os.cpu_count()} threads, a leaner model of the same joint")
    _against_mujoco(rig, cost)


if __name__ == "__main__":
    main()
