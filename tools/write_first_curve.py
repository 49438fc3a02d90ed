"""Write the refined curve of the rig that the dashboard offers first: src/sinew/rigs/first-curve.json."""

import json
import os
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from sinew.apps.dashboard.work.design import FIRST_CURVE, curves_key, design_curves
from sinew.measure.doors import write_text
from sinew.plan.toml import read_spec

ASKED: tuple[Any, ...] = (read_spec("rigs", "paper"), {}, 4.0, 20.0, (1.0, 6.0))
"""As the design page asks when it is opened for the first time."""
_DIGITS = 5


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}")
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return {key: _rounded(one) for key, one in value.items()} if isinstance(value, dict) else value


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        os.environ["SINEW_CACHE"] = folder
        told = {"key": curves_key(*ASKED), "found": _rounded(partial(design_curves, fine=True)(*ASKED))}
    write_text(Path("src/sinew/rigs") / FIRST_CURVE, json.dumps(told, separators=(",", ":")) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
