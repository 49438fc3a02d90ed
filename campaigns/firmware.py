"""The IMU node's firmware on a line's bad days: seeded streams under sanitizers, and what its image takes.

`python -m campaigns.firmware --streams 1000000 --out out/campaigns/firmware.json`: streams of whole, damaged and
spliced packets against the firmware compiled here with address and undefined-behaviour sanitizers; after each the node
must answer a ping. Beside it the size of the image for a Cortex-M7, where there is a compiler for it.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tools.build_firmware import BuildError, build_fuzz, build_qemu, image_size


def run(streams: int, seed: int) -> dict[str, Any]:
    """Return what was sent and heard, and the image's size in bytes.

    Raises BuildError without a compiler, CalledProcessError where the firmware or a sanitizer has failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = build_fuzz(Path(folder))
        done = subprocess.run([program, str(streams), str(seed)], check=True, capture_output=True, text=True)
        told: dict[str, Any] = {"seed": seed, **json.loads(done.stdout)}
        try:
            told["image_bytes"] = image_size(build_qemu(Path(folder)))
        except BuildError as trouble:
            told["image_bytes"] = None
            print(f"no size of an image: {trouble}", file=sys.stderr)
    return told


def main() -> int:
    """Run the campaign; return the exit status."""
    options = argparse.ArgumentParser(description="Fuzz the IMU node's firmware.")
    options.add_argument("--streams", type=int, default=1_000_000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--out", type=Path)
    asked = options.parse_args()
    try:
        told = run(asked.streams, asked.seed)
    except BuildError as trouble:
        print(trouble, file=sys.stderr)
        return 2
    except subprocess.CalledProcessError as trouble:
        print(f"the firmware failed: {trouble.stderr.strip()}", file=sys.stderr)
        return 1
    if asked.out:
        asked.out.parent.mkdir(parents=True, exist_ok=True)
        asked.out.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(told))
    return 0


if __name__ == "__main__":
    sys.exit(main())
