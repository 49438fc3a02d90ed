"""What viewers cost, on a smaller scale than `python -m campaigns.viewers --hours 2 --cycles 60`."""

from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from typing import Any

import pytest
from campaigns.viewers import stream_hours

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("nicegui") is None, reason="the dashboard needs the extra"),
]


def streamed() -> dict[str, Any]:
    """Return what a stream to four viewers cost; in a thread of its own, for a browser's tests leave a loop running."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(stream_hours, hours=0.5, speed=60.0).result()


def test_the_server_does_not_grow_while_four_viewers_watch() -> None:
    found = streamed()
    assert found["samples"] == 0.5 * 3600 * 200
    assert min(found["frames_per_s"]) > 0
    assert abs(found["memory_growth"]) < 0.05
    assert found["memory_spread"] < 0.05


@pytest.mark.realtime
def test_four_viewers_get_20_to_30_frames_a_second() -> None:
    found = streamed()
    assert all(20 <= rate <= 30 for rate in found["frames_per_s"])
