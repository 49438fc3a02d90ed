"""What is built for a processor: its size, and the board's sketch against an outline of the core's names."""

import shutil
import subprocess
from pathlib import Path

import pytest
from tools.build_firmware import CORTEX_M7, CROSS, ROOT, image_size

pytestmark = pytest.mark.slow


def test_the_image_takes_a_small_part_of_the_boards_flash(qemu_image: Path) -> None:
    size = image_size(qemu_image)
    print(size)
    assert size["text"] + size["data"] < 0.05 * 786_432  # what the OpenCR's bootloader leaves for a sketch
    assert size["data"] + size["bss"] < 0.05 * 320 * 1024


@pytest.mark.skipif(shutil.which(CROSS) is None, reason=f"there is no {CROSS}: the sketch is not looked at")
def test_the_boards_sketch_uses_the_core_as_outlined() -> None:
    folders = [f"-I{ROOT / 'opencr/outline'}", f"-I{ROOT / 'node'}"]
    flags = ["-std=c++17", *CORTEX_M7, "-Wall", "-Wextra", "-Werror", "-fno-exceptions", "-fno-rtti", "-fsyntax-only"]
    sketch = ROOT / "opencr/imu_node/imu_node.ino"
    done = subprocess.run([CROSS, *flags, *folders, "-x", "c++", sketch], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.[hc]*")), ids=lambda path: path.name)
def test_every_source_says_its_licence(path: Path) -> None:
    assert path.read_text(encoding="utf-8").startswith("// SPDX-License-Identifier: Apache-2.0\n")


def test_the_build_script_says_what_is_missing(tmp_path: Path) -> None:
    bare = {"PATH": "/bin:/usr/bin"}
    if shutil.which("arduino-cli", path=bare["PATH"]):
        pytest.skip("arduino-cli is installed")
    script = ["sh", str(ROOT / "opencr/build.sh"), str(tmp_path)]
    done = subprocess.run(script, env=bare, capture_output=True, text=True, check=False)
    assert (done.returncode, "arduino-cli" in done.stderr) == (2, True)
