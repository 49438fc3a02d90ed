"""This is where `sinew predict` is asked for more than curves: bands, and a recording to be held against."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from sinew.apps.joint_options import BASE_RIG
from sinew.apps.predict_against import (
    Held,
    asked_of,
    hold_against,
    measured_against,
    millimetres,
    print_against,
)
from sinew.apps.predict_bands import bands_document, print_bands
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinew.apps.predict_rig import Predicted, RigAsked

__all__ = ["Further", "print_further"]


class Further(NamedTuple):
    """What is asked beside the curves. bands: number of draws; seed: of them. against: a recording; fitted_mm: the
    pretensions that the rig was fitted to. start, stop: of the band [Hz] as given."""

    bands: int | None = None
    seed: int = 0
    against: Path | None = None
    fitted_mm: str | None = None
    start: float | None = None
    stop: float | None = None

    @property
    def given(self) -> list[str]:
        """Return the options that were given."""
        named = {"--bands": self.bands, "--against": self.against, "--fitted-mm": self.fitted_mm}
        return [option for option, value in named.items() if value is not None]

    def words(self, asked: "RigAsked") -> list[str]:
        """Return the command's words that ask for the same again. asked: of the rig, before a recording was read."""
        bands = [] if self.bands is None else ["--bands", str(self.bands), "--seed", str(self.seed)]
        against = [] if self.against is None else ["--against", str(self.against)]
        fitted = [] if self.fitted_mm is None else ["--fitted-mm", self.fitted_mm]
        if self.against is None:
            return [*asked.words(), *bands]
        off = [word for effect in asked.without for word in ("--without", effect)]
        return [*off, *bands, *against, *fitted]

    def held(self, rig: str | None) -> Held | None:
        """Return the recording. rig: file or name. Raises SpecError, before long work, for what cannot be meant."""
        if self.fitted_mm is not None:
            if self.against is None:
                raise SpecError("--fitted-mm is about a recording; name one with --against, or leave it out")
            millimetres(self.fitted_mm)
        if self.bands is not None:
            from sinew.plan.toml import load_rig
            from sinew.predict.draws import spread_of

            spread_of(load_rig(rig or BASE_RIG))
        return None if self.against is None else measured_against(self.against, rig)

    def asked(self, held: Held | None, asked: "RigAsked") -> "RigAsked":
        """Return what is asked of the rig, at the recording's settings where there is one."""
        return asked if held is None else asked_of(held, asked, self.start, self.stop)

    def answered(
        self, held: Held | None, found: "Predicted", base: str | None, *, drawn: bool
    ) -> "tuple[dict[str, Any], dict[str, Figure]]":
        """Return (keys of the document, figures by name; none unless drawn). base: file or name of the rig."""
        document: dict[str, Any] = {}
        figures: dict[str, Figure] = {}
        if self.bands is not None:
            keys, bands = bands_document(found, base, self.bands, self.seed)
            document |= keys
            if drawn:
                from sinew.figures.predicted import Curves
                from sinew.figures.predicted_bands import draw_bands

                asked, branches = found.asked, found.prediction.branches
                curves = Curves(found.rig.name, tuple(asked.pretensions), branches, asked.amplitude_deg)
                figures["predicted_bands"] = draw_bands(curves, bands)
        if held is not None:
            document["against"], comparison = hold_against(held, found, self.fitted_mm)
            if drawn:
                from sinew.figures.predicted_against import draw_against

                figures["predicted_against"] = draw_against(comparison)
        return document, figures


def print_further(document: dict[str, Any]) -> None:
    """Print the parts of a prediction that were asked for beside the curves."""
    if "bands" in document:
        print_bands(document)
    if "against" in document:
        print_against(document["against"])
