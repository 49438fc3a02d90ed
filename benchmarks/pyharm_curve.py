"""The reference oscillator followed by pyHarm-os, in an interpreter of its own: `make peers` makes it.

It runs without Sinew: `.venv-peers/bin/python benchmarks/pyharm_curve.py '{...}'` prints one JSON document. Asked:
inertia, stiffness, damping, cubic, torque (SI), band_hz, amplitude (about, its unit of length), settings: a list of
{harmonics, samples, step}, and runs, of each. Told: seconds of each run, and frequency_hz and amplitude along the
curve, in order.

Chosen in its favour: odd harmonics only, amplitude and frequency made dimensionless so that the arc length weighs
both, steps that grow after two good points, no prints. The solver is its default, scipy's `root`; its own Newton's
method took as long. Only `operate` is timed, not the building of the system.
"""

import contextlib
import io
import json
import logging
import sys
import time
from typing import Any

import numpy as np


def model(asked: dict[str, Any], setting: dict[str, Any]) -> dict[str, Any]:
    """Return pyHarm's input of the oscillator: one degree of freedom against the ground, driven by a sine."""
    natural = float(np.sqrt(asked["stiffness"] / asked["inertia"]))
    low, high = (2 * np.pi * f for f in asked["band_hz"])
    ground = {"connect": {"joint": [0]}, "dirs": [0]}
    return {
        "system": {
            "type": "Base",
            "nh": list(range(1, setting["harmonics"] + 1, 2)),
            "nti": setting["samples"],
            "adim": {"status": True, "lc": asked["amplitude"], "wc": natural},
        },
        "substructures": {
            "joint": {
                "matrix": {
                    "M": np.array([[asked["inertia"]]]),
                    "K": np.array([[asked["stiffness"]]]),
                    "C": np.array([[asked["damping"]]]),
                    "G": np.zeros((1, 1)),
                },
                "ndofs": 1,
            }
        },
        "connectors": {
            "hardening": {"type": "CubicSpring", "k": asked["cubic"], **ground},
            "drive": {"type": "CosinusForcing", "amp": asked["torque"], **ground},
        },
        "analysis": {
            "curve": {
                "study": "frf",
                "puls_inf": low,
                "puls_sup": high,
                "ds0": setting["step"] / 4,
                "ds_max": setting["step"],
                "ds_min": 1e-8,
                "corrector": "pseudo_arc_length",
                "stepsize_options": {"consecutive_accept": 2},
                "predictor_options": {"verbose": False},
                "verbose": False,
            }
        },
    }


def curve(asked: dict[str, Any], setting: dict[str, Any]) -> dict[str, Any]:
    """Return the time that pyHarm takes for a curve [s], and the curve: frequency [Hz], largest angle [rad]."""
    from pyHarm.Maestro import Maestro

    with contextlib.redirect_stdout(io.StringIO()):
        maestro = Maestro(model(asked, setting))
        begin = time.perf_counter()
        maestro.operate()
        seconds = time.perf_counter() - begin
    points = [one for one in maestro.nls["curve"].SolList if one.flag_accepted]
    x = np.array([one.x for one in points])
    table = maestro.system.expl_dofs
    order, is_cosine = table["harm"].to_numpy(), (table["cs"] == "c").to_numpy()
    phase = 2 * np.pi * np.arange(20_000) / 20_000
    waves = np.where(is_cosine[:, None], np.cos(np.outer(order, phase)), np.sin(np.outer(order, phase)))
    return {
        "seconds": seconds,
        "frequency_hz": (x[:, -1] * maestro.system.wc / (2 * np.pi)).tolist(),
        "amplitude": [float(np.max(row @ waves)) * maestro.system.lc for row in x[:, :-1]],
        "refused": len(maestro.nls["curve"].SolList) - len(points),
    }


def main() -> None:
    """Print what is asked for in the first argument."""
    logging.disable(logging.CRITICAL)
    begin = time.perf_counter()
    asked = json.loads(sys.argv[1])
    told = []
    for setting in asked["settings"]:
        runs = [curve(asked, setting) for _ in range(asked["runs"])]
        told.append({**setting, **runs[-1], "seconds": [run["seconds"] for run in runs]})
    print(json.dumps({"curves": told, "whole_s": time.perf_counter() - begin}))


if __name__ == "__main__":
    main()
