"""Whatever its parameters and state, a joint that nothing drives only loses energy."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.mechanics.guides import GUIDE_LAWS
from sinew.mechanics.joint import State, dissipation, mechanical_energy, rate, state_at_rest
from sinew.mechanics.parameters import Parameters
from sinew.plan.plan import Group
from sinew.plan.toml import load_rig
from sinew.solve.programs import configure
from sinew.twin.simulate import lane_parameters

configure()
PAPER = load_rig("paper")
RIGS = {
    law: PAPER.model_copy(update={"tendons": PAPER.tendons.model_copy(update={"guide_law": law})}) for law in GUIDE_LAWS
}
share = st.floats(-1, 1)


def _joint(law: str, pretension_mm: float, loss: float, friction: float) -> tuple[Parameters, jax.Array]:
    rig = RIGS[law].with_values({"silicone.loss_factor": loss, "tendons.guide_friction": friction})
    lanes, shortening = lane_parameters([Group("idle", pretension_mm, np.nan, np.nan, 0, 0.0, 1.0)], rig)
    p = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), lanes)
    return p, jnp.asarray(shortening[0])


@jax.jit
def _powers(state: State, p: Parameters) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return (dE/dt by the chain rule, power lost, power of the horn) [W]."""
    slope = jax.grad(mechanical_energy)(state, p)
    moved = rate(0.0, state, p)
    flow = sum(jnp.sum(a * b) for a, b in zip(jax.tree.leaves(slope), jax.tree.leaves(moved), strict=True))
    return jnp.asarray(flow), *dissipation(0.0, state, p)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(list(GUIDE_LAWS)),
    st.floats(0, 16),
    st.floats(0.02, 0.3),
    st.floats(0, 0.015),
    share,
    st.floats(-30, 30),
    share,
    st.floats(-8, 8),
    share,
)
def test_power_balance_holds_at_any_state(
    law: str, pretension_mm: float, loss: float, friction: float, torsion: float, speed: float, lever: float,
    lever_speed: float, bristle: float,
) -> None:  # fmt: skip
    p, shortening = _joint(law, pretension_mm, loss, friction)
    state = state_at_rest(shortening, p)._replace(
        torsion=jnp.asarray(torsion),
        torsion_rate=jnp.asarray(speed),
        lever=jnp.asarray(lever),
        lever_rate=jnp.asarray(lever_speed),
        bristles=(jnp.asarray(bristle),) * len(p.guides.spread),
        memory=tuple(jnp.asarray(0.5 * torsion) for _ in range(4)),
    )
    flow, lost, delivered = (float(power) for power in _powers(state, p))
    scale = 1 + abs(flow) + abs(lost) + abs(delivered)
    assert abs(flow - (delivered - lost)) < 1e-9 * scale
