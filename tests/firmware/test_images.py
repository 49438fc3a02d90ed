"""What is built for a processor: its size, and the board's sketch against an outline of the core's names."""

import shutil
import subprocess
from pathlib import Path

import pytest
from tests.firmware.built import built
from tools.build_firmware import CROSS, ROOT, compile_for_opencr, image_size

pytestmark = pytest.mark.slow


def test_the_image_takes_a_small_part_of_the_boards_flash(qemu_image: Path) -> None:
    size = image_size(qemu_image)
    print(size)
    assert size["text"] + size["data"] < 0.05 * 786_432  # what the OpenCR's bootloader leaves for a sketch
    assert size["data"] + size["bss"] < 0.05 * 320 * 1024


@pytest.mark.parametrize("standard", ["gnu++11", "gnu++17"])
def test_the_boards_sketch_compiles_by_the_cores_flags_and_macros(tmp_path: Path, standard: str) -> None:
    objects = built(lambda folder: compile_for_opencr(folder, standard)[0].parent, tmp_path, CROSS)
    assert len(list(objects.glob("*.o"))) == 1 + len(list((ROOT / "node").glob("*.cpp")))


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
