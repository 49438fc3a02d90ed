"""A folder of its own for each test, and property tests that do not watch the clock."""

from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("sinew", deadline=None)  # a busy computer is no fault of the code
settings.load_profile("sinew")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder, which is the working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
