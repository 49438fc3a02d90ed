"""This is where the pages find what they share: folders, hub, worker, access."""

from dataclasses import dataclass
from pathlib import Path

from sinew.apps.dashboard.hub import Hub
from sinew.apps.dashboard.results import Results
from sinew.apps.dashboard.work.shelf import read_shelf
from sinew.apps.dashboard.work_desk import Work
from sinew.plan.library import read_spec

__all__ = ["Site"]


@dataclass
class Site:
    """What all pages share.

    runs: folder of the runs. rig: name or file of the rig that is offered first. bench: "emulator", "port" or None.
    steering_port: where the browser sends commands. is_locked: whether even watching needs the token.
    results: analysed groups of the run under way, and its prediction, see `sinew.apps.dashboard.results`.
    """

    runs: Path
    rig: str
    bench: str | None
    steering_port: int
    is_locked: bool
    version: str
    hub: Hub
    work: Work
    results: Results

    def rig_text(self, name: str) -> str:
        """Return the TOML text of the rig that is offered first, or of one on the shelf. Raises SpecError."""
        return read_spec("rigs", name) if name == self.rig else read_shelf("rigs", name, self.runs)
