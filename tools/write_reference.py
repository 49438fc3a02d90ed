"""The generated pages of docs/reference: schema, register tables, the command's own help.

`make reference` writes recording.md, results.md, registers.md, cli.md and python.md there anew; a test compares what is
committed with what this program would write.
"""

import inspect
import math
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import cast

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import typer
from typer.testing import CliRunner

import sinew
from sinew.apps.cli import app
from sinew.hardware.bus import Bus
from sinew.hardware.configuration import KNOWN_STATE, Post
from sinew.hardware.motor import DriveServo, TendonServo
from sinew.hardware.registers import (
    BAUD_RATES,
    EXTENDED_POSITION_MODE,
    HARDWARE_ERRORS,
    ICM_20648,
    IMUS,
    MOTORS,
    MPU_9250,
    OPENCR_NODE,
    POSITION_MODE,
    SENSOR_ERROR,
    XH430_W350,
    XM430_W350,
    Register,
    RegisterTable,
)
from sinew.measure import recording as schema
from sinew.plan.toml import load_rig
from tools import write_firmware_registers
from tools.tree import ROOT

_NOTE = "<!-- written by tools/write_reference.py (`make reference`); edit that, not this -->\n"


def _table(rows: Mapping[str, schema.Variable], *, required: bool) -> str:
    """Return a Markdown table of schema rows, with a column for what a recording must have where asked for."""
    lines = ["| variable | dimensions | unit | meaning |" + (" needed |" if required else "")]
    lines.append("|---|---|---|---|" + ("---|" if required else ""))
    for name, row in rows.items():
        unit = {"": "text", "*": "attribute `units`"}.get(row.unit, row.unit)
        line = f"| `{name}` | {', '.join(row.dims)} | {unit} | {row.meaning} |"
        lines.append(line + (f" {'yes' if row.required else ''} |" if required else ""))
    return "\n".join(lines) + "\n"


def recording_page() -> str:
    """Return the page on recordings, from `sinew.measure.recording`."""
    return f"""{_NOTE}
# Recording

A recording is an `xarray.Dataset`, stored as NetCDF-4, with the attribute `schema = "{schema.RECORDING_SCHEMA}"`, or
`"{schema.SPATIAL_SCHEMA}"` where the head bends, sways, or has its orientation recorded. The second is the first with
what is marked below; both are read, and one of an upright head that only turns is still written as the first.
It holds samples and segments as a contiguous ragged array in the CF sense: the samples of segment *i* are the
`row_size[i]` samples after those of the segments before it. The twin, the emulated bench, the real bench and imported
files give the same thing.

It is checked when it is made, written and read. Besides the tables below:

- it has at least one response: `torsion_rad`, `gyro_rad_s` or `response`;
- no sample is NaN or infinite, and `time_s` increases inside each segment (segments may lie apart in time);
- every segment has at least one sample, its `kind` is settle, steady, ring-down, idle or tracking, and its pretension
  is not negative;
- the segments tell all of {", ".join(f"`{name}`" for name in schema.SPATIAL_SEGMENTS)}, or none of it; they and
  `orientation` are of schema `{schema.SPATIAL_SCHEMA}`.

## Samples

{_table(schema.SAMPLE_VARIABLES, required=True)}
## Segments

{_table(schema.SEGMENT_VARIABLES, required=True)}
What belongs to which kind of segment: [decision 5](../decisions/0005-segments.md).

## Attributes

| attribute | meaning |
|---|---|
| `schema` | `{schema.RECORDING_SCHEMA}` or `{schema.SPATIAL_SCHEMA}` |
| `source` | twin, emulator, bench or import; an emulated bench says so itself, whoever opened its port |
| `expected` | what the twin foretold of the plan, as JSON, for `sinew.analysis.doubts`; empty where nothing was |
| `backbones` | of a tracked resonance: JSON, what was predicted, as `expected` of [`sinew track`](json.md#track) |
| `rig`, `plan` | their TOML texts, whole; empty where there is none |
| `versions` | of Sinew, Python and the packages that made the numbers |
| `seed` | of the random numbers; -1 where there are none |
| `registers` | of a bench: JSON, the motors' registers as read back before each run's first group |
| `tendon_limit_a` | of a bench whose tendon motors yield at a current: JSON, mean of their limits by pretension in mm |
| `pauses` | of a bench: JSON, what was said of each pause of the computer after which the run went on by itself |
| `register_checks` | of a bench: how often they were read again after a group and found the same |
| `readings_stale`, `readings_impossible` | of a bench: left out as of an earlier cycle, or as what cannot be true |
| `samples_lost` | of a bench: samples that the IMU's board did not read; absent where it does not count them |
| `content_hash` | SHA-256 over names, dimensions, values and attributes, checked on reading |
| `Conventions`, `featureType` | what CF readers look for |

The dimension `axis` counts x, y, z of the head's frame H ([conventions](../explanation/conventions.md)), `quaternion`
w, x, y, z of the turn from B to H; `tendon`
counts the tendons in the order of the rig. No dimension of a recording has a coordinate: places are positions from 0,
so take them by `isel`. The first tendon is `isel(tendon=0)` here and `tendon_1` in exported tables; `repeat` counts
from 0 here and from 1 in [results](results.md). `sinew.measure.recording.segment_slices`
says which samples are a segment's.
"""


def results_page() -> str:
    """Return the page on results, from `sinew.measure.recording`."""
    groups: dict[str, dict[str, schema.Variable]] = {}
    titles = {
        ("pretension_mm", "frequency_hz", "repeat"): "Response, of every group of every repeat",
        ("pretension_mm", "repeat"): "Ring-down, of every decay",
        ("pretension_mm", "repeat", "window_start_periods"): "Decay windows, of every planned decay",
        ("pretension_mm",): "Resonance, over the repeats",
        ("pretension_mm", "frequency_hz", "repeat", "channel"): "Coupling, of every group of every repeat and channel",
        ("frequency_hz",): "Axes",
    }
    energy = {end for name in schema.ENERGY_QUANTITIES for end in (name, *schema.companions(name))}
    for name, row in schema.RESULT_VARIABLES.items():
        dims = ("frequency_hz",) if name in row.dims else row.dims
        title = titles[dims]
        if name in schema.POWER_COLUMNS:
            title = "Power, of every group of every repeat"
        elif name in energy:
            title = "Energy, over the repeats"
        groups.setdefault(title, {})[name] = row
    tables = "\n".join(f"## {title}\n\n{_table(rows, required=False)}" for title, rows in groups.items())
    return f"""{_NOTE}
# Results

Results are an `xarray.Dataset`, stored as NetCDF-4, with the attribute `schema = "{schema.RESULTS_SCHEMA}"`, over the
axes `pretension_mm`, `frequency_hz` and `repeat`, of planned ring-downs `window_start_periods`, where the decay
begins, and of a head that bends or sways `channel`, which of its motions. All are index coordinates:
`results.sel(pretension_mm=1)` is what was measured at 1 mm, wherever that stands, and a pretension that was not
measured is refused; `results.sel(frequency_hz=3.2, method="nearest")` takes the nearest. Each mark stands once and is
finite.
A part
that the recording cannot give (no sweep, no ring-down) is absent as a whole; a single missing measurement is NaN. A
quantity with an interval has companions whose suffix stands before the unit: `resonance_hz` has `resonance_std_hz`,
`resonance_low_hz` and `resonance_high_hz`, the standard deviation over the repeats and the ends of the 90 % interval.

{tables}
How each number is made: [analysis](../explanation/analysis.md), [energy](../explanation/energy.md). Beside the energy
stands the attribute `idle_power_w`, what all servos draw with their torque off by data sheet.
"""


def _help(*command: str) -> str:
    """Return what `sinew COMMAND --help` prints on a terminal of 100 columns."""
    said = CliRunner().invoke(app, [*command, "--help"], prog_name="sinew", terminal_width=100, color=False)
    return "\n".join(line.rstrip() for line in said.output.strip().splitlines())


def cli_page() -> str:
    """Return the page on the command `sinew`, from its own help."""
    names = typer.main.get_group(app).commands
    sections = "\n".join(f"## sinew {name}\n\n```text\n{_help(name)}\n```\n" for name in names)
    return f"""{_NOTE}
# The command `sinew`

`make setup` puts it at `.venv/bin/sinew`. Results go to stdout, progress and remarks to stderr; progress bars are shown
on a terminal and not in a pipe. With `--json` stdout holds one JSON document and nothing else ([its form](json.md)).

| exit status | meaning |
|---|---|
| 0 | success |
| 2 | wrong input: one line on stderr says what was found, what was expected, what to do; nothing half-written stays |
| 130 | interrupted |

A rig or plan is the path of a TOML file, or the name of one that ships with Sinew: `paper`, and for a quick look the
plan `short`.

{sections}"""


def _register_row(row: Register) -> str:
    kind = "signed" if row.signed else ""
    span = f"{row.lowest} to {row.highest}" if row.writable else ""
    unit = "" if row.unit == "1" else row.unit
    count = f"{row.scale:.6g} {unit}".strip() if row.scale != 1 or unit else ""
    initial = "" if row.initial is None else str(row.initial)
    access = "RW" if row.writable else "R"
    return f"| {row.address} | {row.size} | `{row.name}` | {access} | {kind} | {count} | {span} | {initial} |"


def _register_table(table: RegisterTable) -> str:
    """Return a Markdown table of registers; of the indirect ones only the first and the last of a run."""
    lines = ["| address | bytes | register | access | kind | one count | counts allowed | initial |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    indirect = [row for row in table if row.name.startswith("indirect_")]
    runs = {(row.name.rstrip("0123456789"), row.address) for row in indirect}
    inner = {
        row.address
        for row in indirect
        if {(row.name.rstrip("0123456789"), row.address + way) for way in (-row.size, row.size)} <= runs
    }
    rows = [row for row in table if row.address not in inner]
    return "\n".join([*lines, *(_register_row(row) for row in rows)]) + "\n"


def _unlike(table: RegisterTable, first: RegisterTable) -> str:
    """Return the section of a motor: in what its registers differ from those of the first one."""
    other = RegisterTable(
        table.model, table.number, tuple(r for r in table if r.name not in first or r != first[r.name])
    )
    lacks = [f"`{row.name}`" for row in first if row.name not in table]
    without = f"\nIt has no {lacks[0]} to {lacks[-1]}.\n" if lacks else ""
    return f"## {table.model}, model {table.number}\n\nAs {first.model} except:\n\n{_register_table(other)}{without}"


def registers_page() -> str:
    """Return the page on registers, from the tables of `sinew.hardware`."""
    others = "\n".join(_unlike(table, XH430_W350) for table in MOTORS.values() if table is not XH430_W350)
    bauds = ", ".join(f"{count}: {baud}" for count, baud in enumerate(BAUD_RATES))
    errors = ", ".join(f"bit {bit}: {what}" for bit, what in HARDWARE_ERRORS.items())
    chips = ", ".join(f"{chip:#04x} {name}" for chip, name in ((MPU_9250, "MPU-9250"), (ICM_20648, "ICM-20648")))
    imus = "\n".join(f"## {t.model}, model {t.number:#06x}\n\n{_register_table(t)}" for t in IMUS.values())
    return f"""{_NOTE}
# Registers

The control tables of the bench's motors and of the head's inertial sensor. A register of several bytes has its low byte
first. Counts times *one count* is the quantity in SI, radians or degrees Celsius; no entry there means a plain number.
What speaks them: [bus](../explanation/bus.md).

## {XH430_W350.model}, model {XH430_W350.number}

Registers below {XH430_W350.eeprom_stop} are kept without power and can be written only while `torque_enable` is 0.

{_register_table(XH430_W350)}
Of the 56 indirect addresses and data bytes the table shows the ends of the two runs, 1 to 28 and 29 to 56.

- `baud_rate`: {bauds} baud.
- `operating_mode`: 0 current, 1 velocity, 3 position, 4 extended position, 5 position with current limit, 16 PWM.
- `hardware_error_status`, `shutdown`: {errors}.
- `bus_watchdog`: reads -1 after it has stopped the motor; writing 0 clears it.

{others}
{imus}
- OpenCR node: registers below {OPENCR_NODE.eeprom_stop} are kept without power. `sample_time` is when the newest sample
  was taken, `clock` when the node began its answer; both in its own microseconds, which wrap after 71.6 minutes.
  `samples` counts those taken since the start, `lost_samples` those that the chip made and the node did not read.
- `who_am_i`: {chips}; `filter_delay` is that of the gyroscope's low-pass, for the ICM-20648 assumed: that of one pole.
- `hardware_error_status` of the node, bit {SENSOR_ERROR.bit_length() - 1}: its chip does not answer.
- The node's firmware has this page from the same source, as `firmware/node/register_page.h`.

## What a run sets

Before every run each register below is brought to its value, whatever was there, and read back; after a change of mode
once more. Those kept without power are written where they differ only, the others each time. A write that a motor does
not keep, and a register that a run refuses, end it by name before anything moves. The values are those of the rig
`paper` for a tendon motor in the mode `position` and for the drive; [why](../explanation/bench.md#known-state).

{_known_state_table()}"""


def _known_state_table() -> str:
    """Return a Markdown table of what a run brings the registers to, for the paper's rig."""
    spec = load_rig("paper")
    bus = cast(Bus, None)  # nothing is asked
    pulling = TendonServo(bus, "tendon 1", 1, XH430_W350, 1, current_limit=math.inf, supply=12.0)
    tendon = Post(pulling, spec, EXTENDED_POSITION_MODE)
    window = math.radians(spec.limits.drive_window_deg)
    drive = Post(DriveServo(bus, "drive", 5, XM430_W350, 1, zero=2048, window=window), spec, POSITION_MODE)
    lines = ["| register | tendon | drive | rule | why |", "|---|---|---|---|---|"]
    for row in KNOWN_STATE:
        cells = []
        for post in (tendon, drive):
            limits = {"current_limit": post.counts("current_limit", post.most_a), "pwm_limit": post.full_duty()}
            wanted = row.wanted(post, limits)
            cells.append("" if wanted is None else str(wanted))
        if row.is_refused and not any(cells):
            cells = ["what the plan needs", ""]
        lines.append(f"| `{row.register}` | {' | '.join(cells)} | {row.rule} | {row.why} |")
    return "\n".join(lines) + "\n"


_FACE: dict[str, Callable[[object], bool]] = {
    "Functions": lambda thing: inspect.isfunction(thing) or inspect.ismodule(thing),
    "Errors": lambda thing: inspect.isclass(thing) and issubclass(thing, Exception),
    "Rigs and plans": lambda thing: inspect.isclass(thing) and thing.__module__.startswith("sinew.plan."),
    "Laws": lambda thing: inspect.isclass(thing) and thing.__module__.startswith("sinew.mechanics."),
    "Results and records": inspect.isclass,
    "Values": lambda thing: True,
}
_MODULE = re.compile(r"\b(?:[a-z_]\w*\.)+(?=[A-Z])")
_LATE = re.compile(r"(: |-> )'([^']*)'(?=[,) ]|$)")
"""An annotation of what is not imported until it is used."""


def python_page() -> str:
    """Return the page on `import sinew as sn`: every name of the face with its signature, words and example."""
    left = {name: getattr(sinew, name) for name in dir(sinew) if not name.startswith("_")}
    parts = [
        f"{_NOTE}\n# Python\n\n`import sinew as sn` has these names; each loads when it is first used. "
        "[How they work together](../how-to/notebook.md).\n"
    ]
    for group, belongs in _FACE.items():
        parts.append(f"## {group}\n")
        for name in [name for name, thing in left.items() if belongs(thing)]:
            parts.append(_face_entry(name, left.pop(name)))
    return "\n".join(parts)


def _face_entry(name: str, thing: object) -> str:
    """Return what a name of the face is, as Markdown: signature, what comes back, arguments, example."""
    text = f"### `sn.{name}`\n\n"
    if inspect.ismodule(thing):
        inner = [one for one in vars(thing).values() if inspect.isfunction(one) and one.__module__ == thing.__name__]
        inner = [one for one in inner if not one.__name__.startswith("_")]
        rows = [f"- `sn.{name}.{one.__name__}`: {_first_line(one)}" for one in inner]
        return text + f"{_first_line(thing)}\n\n" + "\n".join(rows) + "\n"
    names: list[str] = list(getattr(thing, "__annotations__", {}))
    if inspect.isfunction(thing):
        called = _LATE.sub(r"\1\2", _MODULE.sub("", f"{name}{inspect.signature(thing)}"))
        text += f"```py\n{called}\n```\n\n"
        names = list(inspect.signature(thing).parameters)
    if isinstance(thing, dict):
        return text + "One of " + ", ".join(f"`{key}`" for key in thing) + ".\n"
    prose, _, example = (inspect.getdoc(thing) or "").partition("\n>>> ")
    any_name = "|".join(map(re.escape, names)) or "(?!)"
    begins = re.compile(rf"(?:^|(?<=[.;] )|(?<=\n))((?:{any_name})(?:,\s(?:{any_name}))*):\s")
    for paragraph in prose.strip().split("\n\n"):
        said, *rest = begins.split("\n".join(line.strip() for line in paragraph.splitlines()))
        last, raises = (rest[-1] if rest else ""), ""
        if "\nRaises " in last:
            rest[-1], _, raises = last.partition("\nRaises ")
        text += f"{said.strip()}\n\n" if said.strip() else ""
        for arguments, meaning in zip(rest[::2], rest[1::2], strict=True):
            text += f"- **{' '.join(arguments.split())}**: {' '.join(meaning.split())}\n"
        text += "\n" * bool(rest) + (f"Raises {raises}\n\n" if raises else "")
    return text.rstrip() + "\n" + (f"\n```pycon\n>>> {example.strip()}\n```\n" if example else "")


def _first_line(thing: object) -> str:
    return (inspect.getdoc(thing) or "").splitlines()[0]


def reference_pages() -> dict[str, str]:
    """Return the text of every generated page by its path inside the repository."""
    return {
        "docs/reference/cli.md": cli_page(),
        "docs/reference/python.md": python_page(),
        "docs/reference/recording.md": recording_page(),
        "docs/reference/registers.md": registers_page(),
        "docs/reference/results.md": results_page(),
        str(write_firmware_registers.HEADER): write_firmware_registers.header(),
    }


def main() -> int:
    """Write every generated page; return the exit status."""
    for name, text in reference_pages().items():
        (ROOT / name).parent.mkdir(parents=True, exist_ok=True)
        (ROOT / name).write_text(text, encoding="utf-8")
        print(name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
