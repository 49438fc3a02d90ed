"""This is where figures read the rig that a dataset was made with."""

import functools

import xarray as xr

from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_rig

__all__ = ["rig_of"]


def rig_of(dataset: xr.Dataset) -> RigSpec | None:
    """Return the rig in the attributes of a recording or of results, None where there is none.

    Raises SpecError where there is one and it is not valid.
    """
    text = str(dataset.attrs.get("rig", ""))
    return _parsed(text) if text.strip() else None


@functools.lru_cache(maxsize=4)
def _parsed(text: str) -> RigSpec:
    return parse_rig(text)
