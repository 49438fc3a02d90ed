"""This is where `sinew identify` adds what an option asks for: profiles, a bootstrap over repeats, a posterior."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sinew.apps.identify_found import Found
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.identify.fitted import Fit

__all__ = ["add_bootstrap", "add_posterior", "add_profiles"]

Progress = Callable[[float, float], None]

_NONLINEAR = ("loss_factor", "coulomb", "quadratic", "cubic")
_DRAWS, _WARMUP = 500, 300  # of each of two chains: intervals to a tenth of a standard deviation


def add_profiles(found: Found, progress: Progress) -> None:
    """Add the key `profile`: intervals of the nonlinear numbers by their profile likelihood, by name."""
    from sinew.identify.profile import interval90

    fit = _fit_of(found, "--profile")
    chosen = [name for name in fit.parameters if name.startswith(_NONLINEAR)]
    if not chosen:
        found.sentences.append(f"model {fit.model.name} has no nonlinear number to profile")
    told: dict[str, Any] = {}
    for done, name in enumerate(chosen):
        progress(done, len(chosen))
        interval = interval90(fit, name)
        if interval is None:
            found.sentences.append(f"the profile of {name} bounds it on neither side")
            continue
        told[name] = interval.to_json()
        for end, side in ((interval.low, "below"), (interval.high, "above")):
            if not math.isfinite(end):
                found.sentences.append(f"the profile of {name} does not bound it {side}")
    found.document["profile"] = told


def add_bootstrap(found: Found, resamples: int, seed: int, progress: Progress) -> None:
    """Add the key `bootstrap`: the numbers with the intervals that the scatter of whole repeats gives."""
    from sinew.identify.bootstrap import bootstrap_repeats

    fit = _fit_of(found, "--bootstrap")
    scatter = bootstrap_repeats(fit.records, fit.model, resamples=resamples, seed=seed, progress=progress)
    found.document["bootstrap"] = {name: one.to_json() for name, one in scatter.estimates.items()}
    found.sentences.append(f"bootstrap: {scatter.message}")


def add_posterior(found: Found, seed: int, progress: Progress) -> None:
    """Add the key `posterior`: the numbers by the draws of NUTS."""
    from sinew.identify.posterior import sample_posterior

    fit = _fit_of(found, "--posterior")
    posterior = sample_posterior(fit, seed=seed, draws=_DRAWS, warmup=_WARMUP, progress=progress)
    found.posterior = posterior
    found.document["posterior"] = {name: one.to_json() for name, one in posterior.estimates.items()}
    found.sentences.append(f"posterior: {posterior.message}")


def _fit_of(found: Found, option: str) -> "Fit":
    if found.fit is None:
        raise SpecError(f"{option} is for models of one degree of freedom; leave it out with model tendon")
    return found.fit
