"""The two searches for least squares against the 16 nonlinear problems of NIST's Statistical Reference Datasets.

Each problem has certified parameters and standard deviations (11 digits) and two starting points, the first far away.
The models below are typed from the files, which hold them only as prose.
"""

import re
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sinew.analysis.signal.least_squares import least_squares
from sinew.identify.oscillator.least_squares import Problem, Solution, covariance, solve
from sinew.solve.programs import configure

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "nist_strd"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the reference datasets are not beside this repository")


def bell(x, centre, width):
    return jnp.exp(-((x - centre) ** 2) / width**2)


def cubics(x, b):
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def seasons(x, b):
    waves = [(12.0, b[1], b[2]), (b[3], b[4], b[5]), (b[6], b[7], b[8])]
    return b[0] + sum(c * jnp.cos(2 * np.pi * x / p) + s * jnp.sin(2 * np.pi * x / p) for p, c, s in waves)


MODELS = {
    "Bennett5": lambda x, b: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": lambda x, b: b[0] * (1 - jnp.exp(-b[1] * x)),
    "Chwirut2": lambda x, b: jnp.exp(-b[0] * x) / (b[1] + b[2] * x),
    "DanWood": lambda x, b: b[0] * x ** b[1],
    "ENSO": seasons,
    "Eckerle4": lambda x, b: b[0] / b[1] * jnp.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": lambda x, b: b[0] * jnp.exp(-b[1] * x) + b[2] * bell(x, b[3], b[4]) + b[5] * bell(x, b[6], b[7]),
    "Hahn1": cubics,
    "Lanczos3": lambda x, b: b[0] * jnp.exp(-b[1] * x) + b[2] * jnp.exp(-b[3] * x) + b[4] * jnp.exp(-b[5] * x),
    "MGH09": lambda x, b: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda x, b: b[0] * jnp.exp(b[1] / (x + b[2])),
    "MGH17": lambda x, b: b[0] + b[1] * jnp.exp(-x * b[3]) + b[2] * jnp.exp(-x * b[4]),
    "Misra1a": lambda x, b: b[0] * (1 - jnp.exp(-b[1] * x)),
    "Rat43": lambda x, b: b[0] / (1 + jnp.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda x, b: b[0] - b[1] * x - jnp.arctan(b[2] / (x - b[3])) / np.pi,
    "Thurber": cubics,
}
each_problem = pytest.mark.parametrize("name", MODELS)
each_start = pytest.mark.parametrize("start", [1, 2])


@cache
def dataset(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows (start 1, start 2, certified value, certified std) and the data (y, x)."""
    lines = (DATA / f"{name}.dat").read_text().splitlines()
    rows = [line.split("=")[1].split() for line in lines if re.match(r"\s*b\d+\s*=", line)]
    data = lines[max(i for i, line in enumerate(lines) if line.startswith("Data:")) + 1 :]
    return np.array(rows, dtype=float), np.array([line.split() for line in data if line.strip()], dtype=float)


@cache
def solution(name: str, start: int) -> Solution:
    configure()
    rows, data = dataset(name)
    y, x = data.T
    model = jax.jit(lambda b: MODELS[name](x, b) - y)
    slope = jax.jit(jax.jacfwd(lambda b: MODELS[name](x, b)))
    problem = Problem(lambda b: np.asarray(model(b)), lambda b: np.asarray(slope(b)))
    return solve(problem, rows[:, start - 1], tolerance=1e-15, max_evaluations=1000)


def digits(found: np.ndarray, certified: np.ndarray) -> float:
    """Return the fewest digits to which found numbers agree with certified ones (log relative error)."""
    return float(-np.log10(np.maximum(np.abs(found / certified - 1), 1e-16)).min())


def test_all_sixteen_problems_are_tried() -> None:
    assert set(MODELS) == {path.stem for path in DATA.glob("*.dat")}


@each_start
@each_problem
def test_parameters_have_six_certified_digits_standard_deviations_five_and_the_search_converged(
    name: str, start: int
) -> None:
    found, rows = solution(name, start), dataset(name)[0]
    assert found.converged
    assert digits(found.values, rows[:, 2]) >= 6
    assert digits(covariance(found.jacobian, found.residual).std, rows[:, 3]) >= 5


# The search of the analyses ends at 1e-7 and begins near. From afar it finds what MINPACK finds at the same tolerance
# but for Bennett5, where that needs 747 evaluations; both end elsewhere from the first start of MGH17.
NEAR_OR_FAR = [(name, start) for name in MODELS for start in (1, 2)]
LOST = [("Bennett5", 1), ("MGH17", 1)]


@pytest.mark.parametrize(("name", "start"), [one for one in NEAR_OR_FAR if one not in LOST])
def test_the_search_of_the_analyses_ends_at_the_certified_parameters(name: str, start: int) -> None:
    configure()
    rows, data = dataset(name)
    y, x = data.T
    values = jax.jit(lambda b: MODELS[name](x, b))
    slope = jax.jit(jax.jacfwd(values))
    found = least_squares(
        lambda b: (np.asarray(values(b)), lambda: np.asarray(slope(b))), y, rows[:, start - 1], most=1000
    )
    assert found.converged
    assert digits(found.parameters, rows[:, 2]) >= 3.5
