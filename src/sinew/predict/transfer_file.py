"""This is where linear joints become files: JSON for python-control and everybody else, MAT for MATLAB."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import io

from sinew.measure.errors import SpecError
from sinew.measure.netcdf import write_atomically
from sinew.predict.linear import LinearJoint
from sinew.predict.state_space import Channel, Pole, StateSpace

__all__ = ["joint_document", "system_document", "write_transfer"]

_SYSTEMS = ("drive", "lever")


def _pole(pole: Pole) -> dict[str, float]:
    return {
        "real_per_s": pole.s.real,
        "imag_per_s": pole.s.imag,
        "frequency_hz": pole.frequency_hz,
        "damping_ratio": pole.damping_ratio,
    }


def _channel(channel: Channel) -> dict[str, Any]:
    return {
        "input": channel.input,
        "output": channel.output,
        "zeros": [_pole(zero) for zero in channel.zeros],
        "gain": channel.gain,
        "static_gain": channel.static,
    }


def system_document(system: StateSpace) -> dict[str, Any]:
    """Return a state space as numbers and lists: its matrices, names, poles, and zeros and gains of its channels."""
    return {
        **{name: getattr(system, name).tolist() for name in ("a", "b", "c", "d")},
        **{name: list(getattr(system, name)) for name in ("states", "inputs", "outputs")},
        "poles": [_pole(pole) for pole in system.poles()],
        "channels": [_channel(system.channel(o, i)) for i in system.inputs for o in system.outputs],
    }


def joint_document(joint: LinearJoint) -> dict[str, Any]:
    """Return a linear joint as numbers, lists and sentences."""
    return {
        "pretension_mm": joint.pretension_mm,
        "tension_n": joint.tension,
        "guide_stiffness_n_m_rad": joint.guide_stiffness,
        "notes": list(joint.notes),
        **{name: system_document(getattr(joint, name)) for name in _SYSTEMS},
    }


def _cells(values: Sequence[Any]) -> Any:
    cells = np.empty((len(values), 1), dtype=object)
    cells[:, 0] = values
    return cells


def _matlab(joints: Sequence[LinearJoint]) -> dict[str, Any]:
    """Return the variables of a MAT file: `pretension_mm`, a column, and for each system a struct with the cells A, B,
    C, D, a row for each pretension, and the names of states, inputs and outputs."""
    content: dict[str, Any] = {"pretension_mm": np.array([[joint.pretension_mm] for joint in joints])}
    for name in _SYSTEMS:
        systems: list[StateSpace] = [getattr(joint, name) for joint in joints]
        content[name] = {key.upper(): _cells([getattr(s, key) for s in systems]) for key in ("a", "b", "c", "d")}
        content[name] |= {key: _cells(list(getattr(systems[0], key))) for key in ("states", "inputs", "outputs")}
    return content


def write_transfer(joints: Sequence[LinearJoint], document: Any, path: Path) -> tuple[Path, ...]:
    """Write linear joints, atomically, and return the files.

    path: ends with .mat or .json for one file; else a folder, for `transfer.json` and `transfer.mat`.
    document: what the JSON file holds. Raises SpecError for another ending, FileError where nothing can be written.
    """
    if path.suffix and path.suffix not in (".mat", ".json"):
        raise SpecError(f"--out is {path}, expected a name that ends with .json or .mat, or a folder")
    files = (path,) if path.suffix else (path / "transfer.json", path / "transfer.mat")

    def write_json(temporary: Path) -> None:
        temporary.write_text(json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n", "utf-8")

    def write_mat(temporary: Path) -> None:
        io.savemat(str(temporary), _matlab(joints), appendmat=False, format="5", long_field_names=True)

    for file in files:
        write_atomically(file, write_mat if file.suffix == ".mat" else write_json)
    return files
