"""Build the IMU node's firmware: for this computer, for its fuzz campaign, and for a Cortex-M7 in QEMU.

`python -m tools.build_firmware host OUT` and so on; the image for the board is built by firmware/opencr/build.sh.
"""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1] / "firmware"
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Wshadow", "-Werror")
SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
CORTEX_M7 = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-sp-d16", "-mfloat-abi=hard")
BARE = ("-O2", "-ffunction-sections", "-fdata-sections", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics")
CROSS = "arm-none-eabi-g++"
OUTLINE = ROOT / "opencr/outline"
# What ROBOTIS's core for the OpenCR compiles a sketch with (platform.txt and boards.txt of version 1.5.3). The compiler
# that comes with it is GCC 5.4, which has no C++17: the sketch and the portable part are C++11.
OPENCR = (
    "-c", "-g", "-O2", "-std=gnu++11", "-mfloat-abi=softfp", "-mfpu=fpv5-sp-d16", "-DDEBUG_LEVEL=DEBUG_NONE",
    "-ffunction-sections", "-fdata-sections", "-nostdlib", "--param", "max-inline-insns-single=500", "-fno-rtti",
    "-fno-exceptions", "-DBOARD_OpenCR", "-mcpu=cortex-m7", "-DF_CPU=216000000L", "-DARDUINO=10607", "-DARDUINO_OpenCR",
    "-DARDUINO_ARCH_OpenCR", "-mthumb", "-DSTM32F746xx", "-D__OPENCR__",
)  # fmt: skip


class BuildError(Exception):
    """The compiler is not there, or refuses the sources; the sentence says which."""


def node_sources() -> list[Path]:
    """Return the portable part's sources."""
    return sorted((ROOT / "node").glob("*.cpp"))


def build_host(out: Path) -> Path:
    """Return the node for this computer, with address and undefined-behaviour sanitizers."""
    return _compile("g++", (*SANITIZERS, *WARNINGS), [*node_sources(), ROOT / "host/main.cpp"], out / "imu-node")


def build_fuzz(out: Path) -> Path:
    """Return the fuzz campaign's program, with the same sanitizers."""
    flags = ("-g", "-O2", *SANITIZERS[2:], *WARNINGS)
    return _compile("g++", flags, [*node_sources(), ROOT / "host/fuzz.cpp"], out / "imu-node-fuzz")


def build_qemu(out: Path) -> Path:
    """Return the image for QEMU's mps2-an500."""
    script = ROOT / "qemu/mps2-an500.ld"
    flags = (*CORTEX_M7, *BARE, *WARNINGS, "--specs=nano.specs", "--specs=nosys.specs", "-nostartfiles")
    links = (f"-T{script}", "-Wl,--gc-sections")
    return _compile(CROSS, (*flags, *links), [*node_sources(), ROOT / "qemu/main.cpp"], out / "imu-node-m7.elf")


def build_sketch(out: Path) -> Path:
    """Return the OpenCR's sketch for this computer, upon what ROBOTIS's core does for it."""
    flags = (*SANITIZERS, *WARNINGS, f"-I{OUTLINE}", f"-I{ROOT / 'node'}")
    return _compile("g++", flags, [*node_sources(), ROOT / "host/opencr.cpp"], out / "opencr-sketch")


def compile_for_opencr(out: Path, standard: str = "gnu++11") -> list[Path]:
    """Return the objects of the OpenCR's sketch, compiled by the core's flags and macros as the core's tools do it.

    All sources lie in one folder, and the sketch begins with Arduino.h. standard: in place of the core's.
    """
    shutil.copytree(ROOT / "node", out, dirs_exist_ok=True)
    sketch = (ROOT / "opencr/imu_node/imu_node.ino").read_text(encoding="utf-8")
    (out / "imu_node.ino.cpp").write_text(f"#include <Arduino.h>\n{sketch}", encoding="utf-8")
    flags = (*OPENCR, f"-I{OUTLINE}", "-Wall", "-Wextra", "-pedantic-errors", "-Werror")
    return [
        _compile(CROSS, flags, [source], source.with_suffix(".o"), standard) for source in sorted(out.glob("*.cpp"))
    ]


def build_program(sources: list[Path], program: Path) -> Path:
    """Return a program for this computer that is made of sources and the portable part."""
    return _compile("g++", ("-O2", *WARNINGS), [*node_sources(), *sources], program)


def image_size(image: Path) -> dict[str, int]:
    """Return what an image takes, in bytes: text (code and constants), data, bss."""
    said = subprocess.run(["arm-none-eabi-size", image], check=True, capture_output=True, text=True).stdout
    text, data, bss = said.splitlines()[1].split()[:3]
    return {"text": int(text), "data": int(data), "bss": int(bss)}


def _compile(
    compiler: str, flags: tuple[str, ...], sources: list[Path], program: Path, standard: str = "c++17"
) -> Path:
    if shutil.which(compiler) is None:
        cross = "gcc-arm-none-eabi libnewlib-arm-none-eabi libstdc++-arm-none-eabi-newlib"
        package = cross if compiler == CROSS else compiler
        raise BuildError(f"there is no {compiler}; on Debian: apt-get install {package}")
    program.parent.mkdir(parents=True, exist_ok=True)
    command = [compiler, *flags, f"-std={standard}", "-o", str(program), *map(str, sources)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildError(f"{compiler} refuses the firmware:\n{done.stderr}")
    return program


BUILDS = {"host": build_host, "fuzz": build_fuzz, "qemu": build_qemu}


def main() -> int:
    """Build what is asked for; return the exit status."""
    if len(sys.argv) != 3 or sys.argv[1] not in BUILDS:
        print(f"usage: python -m tools.build_firmware {'|'.join(BUILDS)} OUT", file=sys.stderr)
        return 2
    try:
        program = BUILDS[sys.argv[1]](Path(sys.argv[2]))
    except BuildError as trouble:
        print(trouble, file=sys.stderr)
        return 2
    print(program)
    return 0


if __name__ == "__main__":
    sys.exit(main())
