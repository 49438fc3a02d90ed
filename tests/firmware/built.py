"""The firmware built for tests; where a compiler or QEMU is missing, they are skipped and say so."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tools.build_firmware import BuildError


def built(build: Callable[[Path], Path], folder: Path, *tools: str) -> Path:
    """Return what a function of `tools.build_firmware` makes in a folder."""
    for tool in tools:
        if shutil.which(tool) is None:
            pytest.skip(f"there is no {tool}: the firmware is not tried this way")
    try:
        return build(folder)
    except BuildError as trouble:
        if "arm-none-eabi-g++" in tools and "No such file" in str(trouble):
            pytest.skip("the cross compiler's C++ library is not there: libstdc++-arm-none-eabi-newlib")
        raise
