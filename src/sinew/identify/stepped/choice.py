"""What a stepped sine tells: models compared, the mechanics, where it resonates, how that moves with the drive."""

from collections.abc import Callable, Sequence

import numpy as np

from sinew.identify.identified import Identified
from sinew.identify.oscillator.model import get_model
from sinew.identify.stepped.curves import ResponsePeak, peak_of_response, resonance_by_level
from sinew.identify.stepped.fit import ResponseFit, fit_response
from sinew.identify.stepped.points import ResponsePoints
from sinew.measure.errors import RecordingError, SinewError, SpecError
from sinew.twin.cache import configure

LAWS = ("linear", "loss-factor", "coulomb", "cubic", "loss-factor-cubic", "coulomb-cubic")
"""What competes: a quadratic term is asked for by name, a fundamental hardly shows it."""

_GAIN, _CLOSE = 2.0, 6.0  # of the criterion: what a term more has to gain; odds of 20 to 1
_DAMPING = ("damping", "loss_factor", "coulomb")


def identify_response(
    points: ResponsePoints | Sequence[ResponsePoints],
    model: str = "auto",
    *,
    chain: Sequence[str] = (),
    remarks: Sequence[str] = (),
    progress: Callable[[float, float], None] | None = None,
) -> Identified:
    """Return the mechanics behind one stepped sine, or several levels of it with the same mechanics.

    model: a name of `MODELS`, or auto. chain: as of `fit_response`. remarks: sentences on the points, put behind the
    verdict. progress: called with (done, total).
    Raises RecordingError and SpecError where the points tell nothing.
    """
    configure()
    groups = (points,) if isinstance(points, ResponsePoints) else tuple(points)
    names = LAWS if model == "auto" else (model,)
    fits: list[ResponseFit] = []
    refused: SinewError | None = None
    for done, name in enumerate(names):
        if progress is not None:
            progress(done, len(names))
        try:
            fits.append(fit_response(groups, get_model(name), chain=chain))
        except (RecordingError, SpecError) as error:
            refused = refused or error
    if not fits:
        assert refused is not None
        raise refused
    best, verdict = _chosen(fits, compared=model == "auto")
    peaks = [peak_of_response(best, part=part) for part in range(len(groups))]
    levels, moved = _levels(groups, "phase" in chain)
    told = [verdict, *moved, *remarks, best.message, *best.tests.sentences()]
    told += [f"at a drive of {one.input_amplitude:.3g}: {one.reason}" for one in peaks if one.reason]
    ranked = sorted(fits, key=lambda fit: (fit is not best, fit.bic()))
    document = {
        "model": best.model.name,
        "parameters": {name: one.to_json() for name, one in (best.parameters | best.nuisance).items()},
        "natural_frequency_hz": best.natural_frequency_hz.to_json(),
        "damping_ratio": best.damping_ratio.to_json(),
        "rmse": {"train": best.rmse if np.isfinite(best.rmse) else None, "test": None},
        "unit": best.unit,
        "converged": best.converged,
        "message": "; ".join(told),
        "unidentifiable": list(best.unidentifiable),
        "compared": [{"model": one.model.name, "rmse_test": None, "bic": one.bic()} for one in ranked],
        "peaks": [_peak(one) for one in peaks],
        "levels": levels,
    }
    return Identified(document, tuple(told), response=best)


def _chosen(fits: Sequence[ResponseFit], *, compared: bool) -> tuple[ResponseFit, str]:
    """Return the model that the points support, by BIC, the plainer where a term gains little, and the verdict."""
    if not compared:
        return fits[0], f"model {fits[0].model.name} was fitted to {_count(fits[0])}"
    sound = [fit for fit in fits if fit.converged and not _impossible(fit)] or list(fits)
    best = min(sound, key=lambda fit: fit.bic())
    within = [fit for fit in sound if _terms(fit) <= _terms(best) and fit.bic() < best.bic() + _GAIN]
    best = min(within, key=lambda fit: (len(_terms(fit)), fit.bic()))
    close = [fit for fit in sound if not _terms(best) <= _terms(fit) and fit.bic() < best.bic() + _CLOSE]
    if not close:
        return best, f"{_count(best)} support model {best.model.name}"
    others = " and ".join(fit.model.name for fit in close)
    return best, f"cannot tell {best.model.name} from {others}: their BIC is within {_CLOSE:g}"


def _terms(fit: ResponseFit) -> frozenset[str]:
    return frozenset(fit.model.mechanics(fit.points[0].excitation))


def _impossible(fit: ResponseFit) -> bool:
    return any(name.startswith(_DAMPING) and one.high < 0 for name, one in fit.parameters.items())


def _count(fit: ResponseFit) -> str:
    levels = len(fit.points)
    return f"{sum(one.size for one in fit.points)} steady states{f' at {levels} levels' if levels > 1 else ''}"


def _peak(one: ResponsePeak) -> dict[str, object]:
    drive: dict[str, object] = {"input_amplitude": one.input_amplitude}
    return drive | {name: getattr(one, name).to_json() for name in ("frequency_hz", "gain", "phase_90_hz")}


def _levels(groups: Sequence[ResponsePoints], turned: bool) -> tuple[dict[str, object] | None, list[str]]:
    """Return how the resonance moves with the level, without a law for it, and a sentence; None for one level."""
    if len(groups) < 2:
        return None, []
    try:
        found = resonance_by_level(groups, turned=turned)
    except RecordingError as error:
        return None, [f"the levels one by one tell no resonance: {error}"]
    document: dict[str, object] = {
        "verdict": found.verdict,
        "shift_hz": found.shift_hz.to_json(),
        "bend_hz": found.bend_hz.to_json(),
    }
    return document, [f"without a law: {found.verdict}"]
