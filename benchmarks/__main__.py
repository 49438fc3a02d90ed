"""The command of the benchmarks: all by `make bench`, one by `python -m benchmarks bus --seconds 20`."""

import sys
from collections.abc import Callable, Sequence

from benchmarks import (
    arm,
    bent_speed,
    broadband_speed,
    bus_loop,
    commands,
    design,
    gpu,
    identify_speed,
    mujoco_model,
    prediction,
    recording_speed,
    rod,
    run_index,
    serve,
    sliders,
    solid_cylinder,
    sweep_fit,
    swing_speed,
    twin_speed,
)

PARTS: dict[str, Callable[[Sequence[str]], None]] = {
    "twin": lambda _: twin_speed.main(),
    "bus": bus_loop.main,
    "commands": lambda _: commands.main(),
    "broadband": lambda _: broadband_speed.main(),
    "recording": lambda _: recording_speed.main(),
    "sweep": sweep_fit.main,
    "identify": identify_speed.main,
    "prediction": lambda _: prediction.main(),
    "design": design.main,
    "gpu": gpu.main,
    "sliders": sliders.main,
    "solid": lambda _: solid_cylinder.main(),
    "rod": lambda _: rod.main(),
    "bent": lambda _: bent_speed.main(),
    "mjcf": mujoco_model.main,
    "swing": lambda _: swing_speed.main(),
    "arm": arm.main,
    "runs": run_index.main,
    "serve": serve.main,
}


def main() -> None:
    """Run the benchmark that is named, with its options, or all, and print their tables."""
    asked = sys.argv[1:2]
    if asked and asked[0] not in PARTS:
        raise SystemExit(f"found {asked[0]}, expected one of {', '.join(PARTS)}, or nothing for all")
    for name in asked or PARTS:
        PARTS[name](sys.argv[2:])


if __name__ == "__main__":
    main()
