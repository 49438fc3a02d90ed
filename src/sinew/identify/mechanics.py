"""This is where the numbers of a solution get their names, units and intervals."""

import numpy as np
from numpy.typing import NDArray

from sinew.identify.certainty import Covariance, estimates, find_unidentifiable
from sinew.identify.layout import Layout, free_mechanics
from sinew.identify.least_squares import Solution
from sinew.identify.model import NATURAL, WORDS, parameter_name
from sinew.measure.estimate import Estimate

__all__ = ["mechanical_parameters", "nuisance_parameters", "oscillation", "unidentifiable_directions"]

Array = NDArray[np.float64]


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    ends = sorted((estimate.low * factor, estimate.high * factor))
    return Estimate(estimate.value * factor, estimate.std * abs(factor), ends[0], ends[1])


def mechanical_parameters(layout: Layout, solution: Solution, certainty: Covariance) -> dict[str, Estimate]:
    """Return the mechanical numbers by name with unit, over the inertia and, where the input is a torque or force in
    N m or N on an angle or a length, in full."""
    record, scales = layout.parts[0].record, layout.parts[0].scales
    found, full = {}, {}
    gain = next((k for k, entry in enumerate(layout.entries) if entry.local == "gain"), None)
    inertial = _INERTIAL.get((record.motion_unit, record.input_unit)) if gain is not None else None
    for k, one in enumerate(estimates(solution.values, certainty)):
        entry = layout.entries[k]
        if entry.local not in free_mechanics(layout.model, record):
            continue
        name = parameter_name(entry.local, record.excitation, record.motion_unit, record.input_motion_unit)
        found[name + (entry.label() if entry.group else "")] = _scaled(one, scales.physical(entry.local))
        if inertial is not None and gain is not None and entry.local in inertial:
            factor = (1.0 if entry.local == "gain" else scales.physical(entry.local)) / scales.physical("gain")
            whole = _over(k, gain, solution.values, certainty)
            full[inertial[entry.local] + (entry.label() if entry.group else "")] = _scaled(whole, factor)
    return found | full


_INERTIAL: dict[tuple[str, str], dict[str, str]] = {
    ("rad", "N*m"): {
        "gain": "inertia_kg_m2",
        "stiffness": "stiffness_n_m_per_rad",
        "damping": "damping_n_m_s_per_rad",
        "coulomb": "coulomb_n_m",
        "quadratic": "quadratic_n_m_per_rad2",
        "cubic": "cubic_n_m_per_rad3",
    },
    ("m", "N"): {
        "gain": "mass_kg",
        "stiffness": "stiffness_n_per_m",
        "damping": "damping_n_s_per_m",
        "coulomb": "coulomb_n",
        "quadratic": "quadratic_n_per_m2",
        "cubic": "cubic_n_per_m3",
    },
}
"""Names of the numbers in full, by the units of motion and input: gain becomes the inertia 1/gain."""


def _over(k: int, gain: int, x: Array, certainty: Covariance) -> Estimate:
    """Return x[k]/x[gain], or 1/x[gain] for k = gain, to first order."""
    slope = np.zeros(x.size)
    top = 1.0 if k == gain else float(x[k])
    slope[gain] = -top / x[gain] ** 2
    if k != gain:
        slope[k] = 1.0 / x[gain]
    return Estimate.student(top / float(x[gain]), _std(slope, certainty), certainty.degrees_of_freedom)


def nuisance_parameters(layout: Layout, solution: Solution, certainty: Covariance) -> dict[str, Estimate]:
    """Return start and rest position of every record; the creep time is the logarithm of its share of the record."""
    found = {}
    for entry, one in zip(layout.entries, estimates(solution.values, certainty), strict=True):
        part = layout.parts[max(entry.record, 0)]
        if entry.local in layout.model.nuisance(part.record.excitation):
            size = {"offset": part.unit_size, "drift": part.unit_size, "creep_time": 1.0, "memory": 1.0}
            factor = size[entry.local] if entry.local in size else part.scales.physical(entry.local)
            found[entry.local + entry.label()] = _scaled(one, factor)
    return found


def oscillation(layout: Layout, solution: Solution, certainty: Covariance) -> tuple[Estimate, Estimate]:
    """Return natural frequency [Hz] and damping ratio of the first group, standard deviations to first order."""
    entries, x = layout.entries, solution.values
    at = {entry.local: k for k, entry in reversed(list(enumerate(entries)))}
    stiffness = float(x[at["stiffness"]])
    freedom = certainty.degrees_of_freedom
    if stiffness <= 0:
        unknown = Estimate(np.nan, np.nan, np.nan, np.nan)
        return unknown, unknown
    root = float(np.sqrt(stiffness))
    hertz = layout.parts[0].scales.omega / (2 * np.pi)
    slope = np.zeros(x.size)
    slope[at["stiffness"]] = hertz / (2 * root)
    frequency = Estimate.student(hertz * root, _std(slope, certainty), freedom)
    slope = np.zeros(x.size)
    if layout.model.damping == "loss-factor":
        slope[at["loss_factor"]] = 0.5
        return frequency, Estimate.student(0.5 * float(x[at["loss_factor"]]), _std(slope, certainty), freedom)
    damping = float(x[at["damping"]]) / (2 * root)
    slope[at["damping"]] = 1 / (2 * root)
    slope[at["stiffness"]] = -damping / (2 * stiffness)
    return frequency, Estimate.student(damping, _std(slope, certainty), freedom)


def _std(slope: Array, certainty: Covariance) -> float:
    part = np.flatnonzero(slope)
    variance = float(slope[part] @ certainty.matrix[np.ix_(part, part)] @ slope[part])
    return float(np.sqrt(max(variance, 0.0)))


def unidentifiable_directions(layout: Layout, solution: Solution, certainty: Covariance) -> tuple[str, ...]:
    """Return one sentence for each direction that the records do not determine."""
    natural = np.array([NATURAL[entry.local] for entry in layout.entries])
    gain = [k for k, entry in enumerate(layout.entries) if entry.local == "gain"]
    natural[gain] = 0.5 * np.maximum(np.abs(solution.values[gain]), 1e-6)
    names = [WORDS[entry.local] + (f" of {entry.group}" if entry.group else "") for entry in layout.entries]
    n, m = solution.jacobian.shape
    shared = n / (certainty.degrees_of_freedom + m)
    noise = float(np.sqrt(solution.sum_of_squares / max(n - m, 1) * max(shared, 1.0)))
    return find_unidentifiable(names, natural, solution.jacobian, noise)
