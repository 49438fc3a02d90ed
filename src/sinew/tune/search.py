"""This is where many starts are improved together, by gradients: one block is one shape in one silicone.

Each start has weights of its own for the three objectives, drawn evenly from the simplex, and minimises the weighted
sum of their logarithms plus a penalty for limits that are exceeded, which grows. Adam (Kingma and Ba, 2015) does it,
all starts of a block in one compiled step. What a block draws depends on the seed and on its own number, on nothing
else: so the same blocks give the same candidates wherever and in whatever order they run.
"""

from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.plan.toml import parse_rig
from sinew.tune.candidate import OBJECTIVES, SIZES, DesignTarget, Frame, frame_of, judge, unpacked
from sinew.twin.cache import configure

_STEPS = 240
_RATE, _LAST_RATE = 0.05, 0.003
_PENALTY = (3.0, 300.0)
_INSIDE = 0.004
_ROOM = 4.0
_WALL, _EDGE = 1e-3, 8.0
_CLOSE = 1e-6
_QUICK: dict[str, bool] = {}


class Block(NamedTuple):
    """What one worker does. rig: text of the base. target: what is designed for. shape: its name. material: name of the
    silicone, modulus: its G [Pa]. starts: how many. seed, number: of the random starts."""

    rig: str
    target: DesignTarget
    shape: str
    material: str
    modulus: float
    starts: int
    seed: int
    number: int


class Found(NamedTuple):
    """Candidates of a block, n of them, whether feasible or not. sizes: (n, 5), see `SIZES`; objectives: (n, 3), see
    `OBJECTIVES`; pretension [m] and lever's amplitude [rad] at both ends of the band, (n, 2). excess: the largest."""

    shape: str
    material: str
    modulus: float
    sizes: Array
    objectives: Array
    pretension: Array
    lever: Array
    feasible: NDArray[np.bool_]
    excess: Array


def blocks_of(
    text: str, target: DesignTarget, silicones: dict[str, float], shapes: list[str], starts: int, seed: int
) -> list[Block]:
    """Return the blocks of a search, one for each shape and silicone (name: G [Pa]). text: of the base rig."""
    pairs = [(shape, name) for shape in shapes for name in silicones]
    return [
        Block(text, target, shape, name, silicones[name], starts, seed, number)
        for number, (shape, name) in enumerate(pairs)
    ]


@cache
def _step() -> Any:
    """Return the compiled step of Adam: (state, weights (n, 3), step's share, number, G, frame) to the next
    state, of which the first part are the logits (n, 5) of the places."""

    def loss(logit: jax.Array, weights: jax.Array, share: jax.Array, modulus: jax.Array, frame: Frame) -> jax.Array:
        judged = judge(jax.nn.sigmoid(logit), modulus, frame)
        over = jnp.clip(judged.excess + _INSIDE, 0.0, _ROOM)
        penalty = _PENALTY[0] * (_PENALTY[1] / _PENALTY[0]) ** share
        wall = _WALL * jnp.sum(logit**2)
        return weights @ jnp.log(judged.objectives) + penalty * jnp.sum(over + over**2) + wall

    slope = jax.vmap(jax.jacfwd(loss), in_axes=(0, 0, None, None, None))

    def step(
        state: tuple[jax.Array, ...], weights: jax.Array, i: jax.Array, modulus: jax.Array, frame: Frame
    ) -> tuple[jax.Array, ...]:
        x, mean, square = state
        share = i / (_STEPS - 1)
        g = jnp.nan_to_num(slope(x, weights, share, modulus, frame))
        g = g / jnp.maximum(1.0, jnp.linalg.norm(g, axis=1, keepdims=True))
        mean, square = 0.9 * mean + 0.1 * g, 0.99 * square + 0.01 * g**2
        hat, spread = mean / (1 - 0.9 ** (i + 1)), square / (1 - 0.99 ** (i + 1))
        rate = _RATE * (_LAST_RATE / _RATE) ** share
        return jnp.clip(x - rate * hat / (jnp.sqrt(spread) + 1e-8), -_EDGE, _EDGE), mean, square

    return jax.jit(step, compiler_options=_QUICK)


@cache
def _judge() -> Any:
    def judged(logits: jax.Array, modulus: jax.Array, frame: Frame) -> tuple[jax.Array, ...]:
        places = jax.nn.sigmoid(logits)
        found = jax.vmap(judge, in_axes=(0, None, None))(places, modulus, frame)
        sizes = jnp.stack(jax.vmap(unpacked, in_axes=(0, None))(places, frame), axis=1)
        return sizes, found.objectives, found.excess, found.pretension, found.lever

    return jax.jit(judged, compiler_options=_QUICK)


def search_block(block: Block) -> Found:
    """Return the improved candidates of a block."""
    configure()
    rig = parse_rig(block.rig)
    frame = frame_of(rig, block.target, block.shape)
    rng = np.random.default_rng([block.seed, block.number])
    place = rng.uniform(0.05, 0.95, (block.starts, len(SIZES)))
    weights = rng.dirichlet(np.ones(len(OBJECTIVES)), block.starts)
    logits = np.log(place / (1 - place))
    state: Any = (logits, np.zeros_like(logits), np.zeros_like(logits))
    for i in range(_STEPS):
        state = _step()(state, weights, float(i), block.modulus, frame)
    done = _judge()(state[0], block.modulus, frame)
    sizes, objectives, excess, pretension, lever = (np.asarray(leaf) for leaf in done)
    worst = np.nan_to_num(excess.max(axis=1), nan=np.inf)
    feasible = (worst <= _CLOSE) & np.isfinite(objectives).all(axis=1)
    return Found(block.shape, block.material, block.modulus, sizes, objectives, pretension, lever, feasible, worst)
