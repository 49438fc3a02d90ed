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


def build_program(sources: list[Path], program: Path) -> Path:
    """Return a program for this computer that is made of sources and the portable part."""
    return _compile("g++", ("-O2", *WARNINGS), [*node_sources(), *sources], program)


def image_size(image: Path) -> dict[str, int]:
    """Return what an image takes, in bytes: text (code and constants), data, bss."""
    said = subprocess.run(["arm-none-eabi-size", image], check=True, capture_output=True, text=True).stdout
    text, data, bss = said.splitlines()[1].split()[:3]
    return {"text": int(text), "data": int(data), "bss": int(bss)}


def _compile(compiler: str, flags: tuple[str, ...], sources: list[Path], program: Path) -> Path:
    if shutil.which(compiler) is None:
        cross = "gcc-arm-none-eabi libnewlib-arm-none-eabi libstdc++-arm-none-eabi-newlib"
        package = cross if compiler == CROSS else compiler
        raise BuildError(f"there is no {compiler}; on Debian: apt-get install {package}")
    program.parent.mkdir(parents=True, exist_ok=True)
    command = [compiler, "-std=c++17", *flags, "-o", str(program), *map(str, sources)]
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
