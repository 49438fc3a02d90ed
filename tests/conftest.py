"""A folder of its own for each test; property tests that draw the same cases every time and do not watch the clock.

HYPOTHESIS_PROFILE=random draws others.
"""

import os
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault("NPROC", "1")  # tests run beside one another: a core for each is enough
settings.register_profile("sinew", deadline=None, derandomize=True)  # a busy computer is no fault of the code
settings.register_profile("random", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "sinew"))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder, which is the working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
