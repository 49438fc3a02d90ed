"""All of the paper's open questions, asked of a recording."""

from collections.abc import Callable

import numpy as np
import xarray as xr

from sinew.analysis.signal.groups import split_by_drive
from sinew.identify.joint.fit import JointFit, fit_joint
from sinew.measure.errors import SinewError
from sinew.measure.recording import iterate_segments
from sinew.paper.answers.answer import Answer
from sinew.paper.answers.constancy import answer_constancy
from sinew.paper.answers.delay import answer_delay
from sinew.paper.answers.hardening import answer_hardening
from sinew.paper.answers.losses import answer_losses
from sinew.paper.answers.saturation import answer_saturation
from sinew.plan.rig import RigSpec

STEPS = ("the joint", "hardening", "losses")
"""What takes time, in order; `progress` of `answer_questions` names it."""

_MOST_PRETENSIONS = 5
_MOST_STEADY = 4
_MOST_DECAYS = 2

Progress = Callable[[str, float, float], None]


def answer_questions(
    recording: xr.Dataset,
    results: xr.Dataset,
    rig: RigSpec | None = None,
    *,
    beyond: xr.Dataset | None = None,
    joint: JointFit | None = None,
    progress: Progress = lambda _step, _done, _total: None,
) -> list[Answer]:
    """Return one answer for each question: hardening, saturation, losses, constancy, delay.

    recording: of a rig, or imported. results: of `analyse_recording` of it with the same rig. rig: None where none is
    known; then sensors are perfect and the losses cannot be told apart. beyond: results of a sweep at further
    pretensions, for the saturation. joint: the tendon joint fitted to the recording; fitted here where it is None and
    the rig is known. progress: called with (step, done, total).
    """
    if "gain" in results:
        recording = split_by_drive(recording)
    why_not = ""
    if joint is None:
        joint, why_not = _fitted_joint(recording, rig, results, progress)
    return [
        answer_hardening(recording, rig, lambda done, total: progress(STEPS[1], done, total)),
        answer_saturation(results, beyond),
        answer_losses(results, recording, joint, why_not),
        answer_constancy(results),
        answer_delay(results, recording, rig, joint),
    ]


def _fitted_joint(
    recording: xr.Dataset, rig: RigSpec | None, results: xr.Dataset, progress: Progress
) -> tuple[JointFit | None, str]:
    if rig is None:
        return None, "That takes a tendon joint fitted to the recording, and no rig is known; name one."
    if "paper_lehr_damping" not in results:
        return None, ""
    try:
        few = joint_selection(recording)
        return fit_joint([few], rig, progress=lambda done, total: progress(STEPS[0], done, total)), ""
    except SinewError as error:
        return None, f"No tendon joint could be fitted: {error}."


def joint_selection(recording: xr.Dataset) -> xr.Dataset:
    """Return the part of a recording that the tendon joint is fitted to here.

    Of at most five pretensions, evenly spread: two ring-downs, and four steady segments of the first repeat, spread
    evenly over frequency; each with what settled before it.
    """
    rows = list(iterate_segments(recording))
    levels = sorted({segment.pretension_mm for _, segment, _ in rows if segment.kind in ("steady", "ring-down")})
    spread = np.linspace(0, len(levels) - 1, min(_MOST_PRETENSIONS, len(levels))).round().astype(int)
    wanted = {levels[i] for i in spread}
    chosen: set[int] = set()
    for level in wanted:
        mine = [(index, segment) for index, segment, _ in rows if segment.pretension_mm == level]
        steady = [index for index, segment in mine if segment.kind == "steady" and segment.repeat == 0]
        some = np.linspace(0, len(steady) - 1, min(_MOST_STEADY + 2, len(steady))).round().astype(int)
        inner = some[1:-1] if some.size > _MOST_STEADY else some
        chosen |= {steady[i] for i in inner}
        chosen |= {index for index, segment in mine if segment.kind == "ring-down" and segment.repeat < _MOST_DECAYS}
    chosen |= {index - 1 for index in chosen if index > 0 and rows[index - 1][1].kind == "settle"}
    order = sorted(chosen)
    samples = np.concatenate([np.arange(rows[i][2].start, rows[i][2].stop) for i in order]) if order else slice(0, 0)
    return recording.isel(sample=samples, segment=order)
