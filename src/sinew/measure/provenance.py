"""This is where a dataset says what it was made from: rig, plan, versions, seed and content hash."""

import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import xarray as xr

from sinew import __version__

__all__ = ["content_hash", "provenance"]

_PACKAGES = ("numpy", "scipy", "xarray", "jax")
_UNHASHED = ("content_hash",)


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
    """Return the SHA-256 over names, dimensions, values and attributes of a dataset, as hexadecimal text."""
    digest = hashlib.sha256()
    for name in sorted(map(str, dataset.variables)):
        variable = dataset[name]
        digest.update(f"{name}{variable.dims}{variable.shape}".encode())
        values = variable.values
        if values.dtype.kind in "OUS":
            digest.update("\0".join(map(str, values.ravel())).encode())
        else:
            digest.update(np.ascontiguousarray(values).tobytes())
    for key in sorted(map(str, dataset.attrs)):
        if key not in _UNHASHED:
            digest.update(f"{key}={dataset.attrs[key]}".encode())
    return digest.hexdigest()
