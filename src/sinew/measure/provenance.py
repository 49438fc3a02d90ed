"""This is where a dataset says what it was made from: rig, plan, versions, seed and content hash."""

import hashlib
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import xarray as xr

from sinew import __version__

__all__ = ["content_hash", "provenance"]

_PACKAGES = ("numpy", "scipy", "xarray", "jax")
# The command names files and folders; the same data made elsewhere are the same data.
_UNHASHED = ("content_hash", "command")


def provenance(source: str, *, rig: str = "", plan: str = "", seed: int | None = None, **more: Any) -> dict[str, Any]:
    """Return the attributes that every dataset of Sinew carries.

    source: twin, emulator, bench or import.
    rig, plan: their TOML texts, whole; empty where there is none.
    seed: of the random numbers, or None.
    """
    versions = [f"sinew {__version__}", f"python {platform.python_version()}"]
    for package in _PACKAGES:
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return {
        "source": source,
        "rig": rig,
        "plan": plan,
        "versions": "; ".join(versions),
        "seed": -1 if seed is None else int(seed),
        **more,
    }


def content_hash(dataset: xr.Dataset) -> str:
    """Return the SHA-256 over names, dimensions, types, values and attributes of a dataset, as hexadecimal text."""
    digest = hashlib.sha256()
    for name in sorted(map(str, dataset.variables)):
        variable = dataset[name]
        digest.update(f"{name}{variable.dims}{variable.shape}".encode())
        values = variable.values
        if values.dtype.kind in "OUST":
            digest.update("\0".join(map(str, values.ravel())).encode())
        else:
            digest.update(values.dtype.str.encode())
            digest.update(np.ascontiguousarray(values).tobytes())
        digest.update(_attributes_text(variable.attrs).encode())
    digest.update(_attributes_text(dataset.attrs).encode())
    return digest.hexdigest()


def _attributes_text(attrs: Mapping[Any, Any]) -> str:
    """Return attributes as one text, the same before and after a file turned lists into arrays."""
    rows = ((str(key), np.atleast_1d(attrs[key]).tolist()) for key in sorted(attrs, key=str) if key not in _UNHASHED)
    return "\0".join(f"{key}={values}" for key, values in rows)
