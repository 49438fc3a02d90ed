"""This is where a rig becomes what a page draws of it: its shape, its traces, the limit of its tendons."""

from typing import Any

from sinew.apps.dashboard.channels import LiveChannels
from sinew.plan.rig import RigSpec

__all__ = ["drawn_rig"]


def drawn_rig(rig: RigSpec) -> dict[str, Any]:
    """Return what a page draws of a rig, for JSON.

    `shape`: lengths in those of the silicone, and the number of tendons; `labels` of the traces by key;
    `tension_limit_n` [N].
    """
    length = rig.silicone.length.value
    circle = rig.tendons.head_radius.value / length
    radius = 0.5 * rig.silicone.diameter.value / length
    shape = {
        "length": 1.0,
        "radius": radius,
        "circle": max(circle, radius + 0.04),  # tendons that run inside the silicone would not be seen
        "plate": max(circle, radius) + 0.16,
        "lever": 1.2 * max(circle, radius) + 0.3,
        "tendons": rig.tendons.count,
    }
    labels = {channel.key: channel.label for channel in LiveChannels(rig).channels}
    return {"shape": shape, "labels": labels, "tension_limit_n": rig.limits.tension_n}
