"""What a column's name says: its unit, whether it holds times, which part it plays, and which run it is of."""

import difflib
import re
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple, TypeAlias

import pandas as pd  # type: ignore[import-untyped,unused-ignore]

from sinew.measure.errors import RecordingError, UnitError
from sinew.measure.units import canonical_unit, convert

Table: TypeAlias = pd.DataFrame
"""One column for each field, with the names as the file has them (duplicates stay)."""

_CLOCKS = {  # words of loggers for units of time
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek", "sekunden", "segundos", "secondes"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisec", "milliseconds", "millisekunden"), "ms"),
    **dict.fromkeys(("us", "µs", "μs", "usec", "usecs", "micros", "microsec", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanoseconds"), "ns"),
    **dict.fromkeys(("min", "mins", "minutes"), "min"),
    **dict.fromkeys(("h", "hr", "hrs", "hours"), "h"),
}
_SUFFIXES = {  # behind an underscore these can hardly mean anything else
    re.sub(r"[/*]", "_", unit).lower(): unit
    for unit in ("deg/s", "rad/s", "rad/s2", "m/s", "m/s2", "N*m", "s", "ms", "us", "deg", "rad", "m", "cm", "mm", "um")
} | {"v": "V", "mv": "mV", "hz": "Hz", "dps": "deg/s", "ns": "ns"}
_UNIT_WORDS = (
    "deg ° degrees rad mrad m mm cm um µm in N mN kN Nm N*m N·m mNm V mV A mA g mg kg m/s mm/s m/s2 m/s^2 m/s² mm/s2 "
    "rad/s deg/s °/s dps rpm Hz kHz Pa kPa MPa T mT uT µT °C dB % counts"
)
_UNITS = frozenset(_UNIT_WORDS.split())  # behind a stroke, a comma, a colon, a point or "in"
_WORDS_OF_UNITS = frozenset(("g", "G", "mg", "°C", "degC", "dB", "-", "--", "1", "counts", "count", "LSB", "raw"))
_BRACKET = re.compile(r"\s*[\[(]([^\[\]()]*)[\])]\s*$")
_BEHIND = re.compile(r"^(.*[^\s,;:/._])(?:\s*[,;:]\s*|\s+in\s+|\.|_)([^\s,;:_.]+)$")


class Said(NamedTuple):
    """What a name says: its words, its unit, and what stands in its bracket and is no unit; None without one."""

    words: str
    unit: str | None
    unknown: str | None = None


def quantity(name: str) -> Said:
    """Return the words of a column's name and the unit that it states.

    Every usual form is read: "x [mm]", "x (mm)", "x/mm", "x, mm", "x:mm", "x in mm", "x.mm", "x_mm", "micros()".
    A path begins with a stroke, and its last name is no unit: "/scope/A".
    """
    bracket = _BRACKET.search(name)
    words = name[: bracket.start()].strip() if bracket else name.strip()
    if bracket and (text := bracket[1].strip()):
        clock = _CLOCKS.get(text.lower())
        if clock or _is_read(text):
            return Said(words, clock or text)
        return Said(words, quantity(words).unit if words else None, text)
    found = re.match(r"^([^/]*[^/\s])\s*/\s*(\S+)$", words) or _BEHIND.match(words)
    if found and found[2] in _UNITS and not re.search(rf"[._]{re.escape(found[2])}$", words):
        return Said(found[1].strip(), found[2])
    for suffix in sorted(_SUFFIXES, key=len, reverse=True):
        if words.lower().endswith(f"_{suffix}") and len(words) > len(suffix) + 1:
            return Said(words[: -len(suffix) - 1], _SUFFIXES[suffix])
    clock = _CLOCKS.get(found[2].lower()) if found else None
    if found and clock and _TIME.fullmatch(_joined(found[1])):
        return Said(found[1].strip(), clock)
    alone = _CLOCKS.get(words.lower(), "s")
    return Said(words, None if alone in ("s", "h", "min") else alone)


def unit_in_name(column: str) -> str | None:
    """Return the unit that a column's name states, or None."""
    return quantity(column).unit


_RATES = re.compile(r"fs|fsample|samplerate|samplingrate|samplefrequency|samplingfrequency|fsamp|ratek?hz|fshz", re.I)
_STEPS = re.compile(r"dt|ts|timestep|sampletime|samplingtime|sampleinterval|deltat|deltax", re.I)


def stated_step(name: str, number: float, unit: str = "") -> float | None:
    """Return the sampling step [s] that a number states by its name, as "fs (kHz)" or "Delta_X"; None without.

    unit: stated apart from the name. None too where the unit is not understood: then the rate is asked for.
    """
    said = quantity(name)
    word = re.sub(r"[\s_:]|[\[(].*", "", said.words)
    unit = re.sub(r"(samples?|sa?)(/s(ec)?|ps)$", "Hz", said.unknown or said.unit or unit, flags=re.I)  # "kS/s" is kHz
    is_rate = _RATES.fullmatch(word) or _RATES.fullmatch(word + unit)
    if not 0 < number < float("inf") or not (is_rate or _STEPS.fullmatch(word)):
        return None
    try:
        return 1.0 / (number * convert(unit or "Hz", "Hz")) if is_rate else number * convert(unit or "s", "s")
    except UnitError:
        return None


def unit_suffix(unit: str) -> str | None:
    """Return the suffix that states a unit in a name ("rad/s" gives "rad_s"), or None where there is none."""
    return next((suffix for suffix, stated in _SUFFIXES.items() if stated == unit), None)


def _is_read(unit: str) -> bool:
    try:
        canonical_unit(unit)
    except UnitError:
        return False
    return True


def are_units(cells: Sequence[str]) -> bool:
    """Return whether a line holds units and nothing else: one of time, two in common use, or all in brackets.

    A unit is also what pint finds ambiguous, or without a zero.
    """
    texts = [cell.strip() for cell in cells if cell.strip()]
    bare = [text.strip("[]()").strip() for text in texts]
    known = {"", *_WORDS_OF_UNITS, *_UNITS, *(text for text in bare if text.lower() in _CLOCKS)}
    boxed = all(text[0] in "[(" and text[-1] in ")]" for text in texts)
    sure = any(text.lower() in _CLOCKS for text in bare) or (len(bare) > 1 and _UNITS.issuperset(bare))
    return (
        bool(texts) and (boxed or sure) and all(one in known or any(map(_is_read, (one, one.lower()))) for one in bare)
    )


def with_unit(name: str, unit: str | None) -> str:
    """Return a column's name with a unit that the file states apart from it, where it is one and none is in the name.

    A word for a unit that is none ("Amplitude", "counts") is left out.
    """
    text = (unit or "").strip().strip("[]()").strip()
    spellings = (_CLOCKS.get(text.lower(), text), text.lower())
    stated = next((one for one in spellings if _is_read(one) or one in ("g", "G", "mg")), "1")
    return name if stated in ("1", "") or unit_in_name(name) is not None else f"{name} [{stated}]"


def bare_name(name: str) -> str:
    """Return a column's name without the bracket at its end."""
    return _BRACKET.sub("", name).strip()


def unlike(names: Sequence[str]) -> list[str]:
    """Return names of which no two are the same: the second becomes "NAME 2", before its bracket."""
    found: list[str] = []
    for name in names:
        again, fresh, bare = 1, name, bare_name(name)
        while fresh in found:
            again += 1
            fresh = f"{bare} {again}{name[len(bare) :]}"
        found.append(fresh)
    return found


# Which are times, and which part the others play: whole words decide, never a part of one.

_TIME = re.compile(
    r"t|times?|zeit(en)?|tempo|temps|tiempo|tid|czas|sec(ond)?s?|xvalue|timestamps?|stamp|elapsed(time)?|timeelapsed|"
    r"rel(ative)?time|hosttime|logtime|headerstamp|clock|uptime|uhrzeit|datetime|zeitstempel|sys(tem)?time|"
    r"abs(olute)?time|unixtime|epoch(time)?|(time)?(millis|micros)|time(sec|seconds)"
)
_TIME_WORDS = frozenset(("time", "timestamp", "stamp", "zeit", "elapsed"))
_ROLES = {
    "none": "volt volts voltage supply battery temp temperature temperatur id index idx row sample samples seq "
    "sequence frame status error flag nr no count lap crc checksum",
    "drive": "drive force torque input command cmd commanded setpoint goal target desired demand reference excitation "
    "shaker hammer lever base antrieb anregung kraft u",
    "response": "response output position pos angle present actual measured gyro gyroscope acc accel acceleration "
    "accelerometer velocity displacement deflection strain weg winkel",
    "frequency": "freq frequency frequenz frequencies f",
    "spectrum": "psd asd fft spectrum spec mag magnitude phase gain coherence frf re im real imag amplitude",
    "angle": "angle winkel heading yaw pitch roll theta phi psi position pos encoder joint azimuth rotation "
    "orientation",
}
_WORDS = {role: frozenset(words.split()) for role, words in _ROLES.items()}
Role: TypeAlias = Literal["time", "none", "drive", "response", ""]


def _joined(words: str) -> str:
    return re.sub(r"[\s_.\-]+", "", words.rsplit("/", 1)[-1].lower())


def words_of(name: str) -> list[str]:
    """Return the words of a name in small letters, without its unit: "goalPosition_2 (deg)" has goal, position."""
    text = re.sub(r"[_\W\d]+", " ", quantity(name).words)
    return [word.lower() for word in re.findall(r"[A-ZÄÖÜ]?[a-zäöüß]+|[A-ZÄÖÜ]+(?![a-z])", text)]


def says(name: str, what: str) -> bool:
    """Return whether a word of a name is one of those for a role, "frequency", "spectrum" or "angle"."""
    words = words_of(name)
    return not _WORDS[what].isdisjoint(words) or (what == "drive" and "set point" in " ".join(words))


def is_time_name(name: str) -> bool:
    """Return whether a column's name says that it holds times."""
    said, words = quantity(name), words_of(name)
    if said.unit is not None and said.unit not in _CLOCKS:
        return False
    joined = _TIME.fullmatch(_joined(said.words)) or (said.unit is not None and said.words.lower() in _CLOCKS)
    return bool(joined) or not _TIME_WORDS.isdisjoint((*words[:1], *words[-1:]))


def role_of(name: str) -> Role:
    """Return the part that a column plays by its name; "" where it does not say."""
    if is_time_name(name):
        return "time"
    roles: tuple[Role, ...] = ("none", "drive", "response")
    return next((role for role in roles if says(name, role)), "")


def over_frequency(table: Table) -> str | None:
    """Return the column that makes a table one over frequency and no record over time: its first; None of others.

    By its name or its unit; or all others are called psd, fft, phase and so on. A first column of times makes none.
    """
    names = list(map(str, table.columns))
    if len(names) < 2 or not len(table) or is_time_name(names[0]):
        return None
    first = quantity(names[0])
    if says(names[0], "frequency") or first.unit in ("Hz", "kHz"):
        rising = pd.to_numeric(table.iloc[:, 0], errors="coerce").dropna().diff().dropna()
        return names[0] if len(rising) and (rising >= 0).mean() > 0.9 else None
    return names[0] if all(says(name, "spectrum") for name in names[1:]) else None


def time_columns(table: Table) -> list[str]:
    """Return the columns that are times by their names."""
    return [name for name in map(str, table.columns) if is_time_name(name)]


def number_columns(table: Table) -> list[str]:
    """Return the columns that hold numbers and no times, by their names."""
    found = []
    for name, (_, column) in zip(map(str, table.columns), table.items(), strict=True):
        dates = column.dtype.kind in "mM" or isinstance(column.dtype, pd.DatetimeTZDtype)
        if not is_time_name(name) and not dates and (held := column.count()):
            values = column if column.dtype.kind in "fiu" else pd.to_numeric(column, errors="coerce")
            found += [name] if values.count() >= 0.9 * held else []
    return found


def find_columns(table: Table, spec: str) -> tuple[list[str], str | None]:
    """Return (columns, unit) that a specification "COL", "COL:unit" or "COL,COL,COL:unit" names.

    An exact column name goes first, whatever it holds, then one without the bracket at its end ("Angle" of
    "Angle (deg)") where that is unique; the unit stands after the last colon; several columns are separated by commas.
    The unit is None where none was written.
    Raises RecordingError for a column that is missing or not unique, with the columns that were found.
    """
    present = [str(name) for name in table.columns]
    bare = [bare_name(name) for name in present]

    def meant(name: str) -> str | None:
        return name if name in present else present[bare.index(name)] if bare.count(name) == 1 else None

    head, colon, unit = spec.rpartition(":")
    for text, stated in ((spec, None), (head, unit.strip())):
        whole = meant(text)
        names = [whole] if whole is not None else [meant(name.strip()) for name in text.split(",")]
        known = [name for name in names if name is not None]
        if len(known) == len(names):
            return [_unique(present, name) for name in known], stated
        if not colon:
            break
    wanted = (head if colon else spec).split(",")
    raise RecordingError(_missing(next((n.strip() for n in wanted if meant(n.strip()) is None), spec), present))


def _unique(present: Sequence[str], name: str) -> str:
    if (count := present.count(name)) > 1:
        raise RecordingError(
            f"column {name!r} occurs {count} times; name all columns anew, in their order (--columns, columns=)"
        )
    return name


def _missing(name: str, present: Sequence[str]) -> str:
    close = difflib.get_close_matches(name.lower(), [p.lower() for p in present], n=1, cutoff=0.5)
    meant = next((p for p in present if close and p.lower() == close[0]), None)
    return f"no column {name!r}{f', did you mean {meant!r}?' if meant else ';'} columns found: {listed(present)}"


def listed(names: Iterable[object], most: int = 24) -> str:
    """Return names with commas between them, no more than `most`."""
    words = list(map(str, names))
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return (", ".join(words[:most]) + more) or "none"


# Several runs in one table, beside one another: a label in their names, or over them.

_RUN_WORD = r"(?:Run|Trial|Set|Data ?Set|Lauf|Messung|Series|Serie)"
_LABELS = (
    re.compile(rf"^(?P<label>Latest|{_RUN_WORD} ?#? ?\d+)\s*[:.|]\s*(?P<name>\S.*)$", re.IGNORECASE),
    re.compile(rf"^(?P<name>\S.*?)[\s,;:]+(?P<label>{_RUN_WORD} ?#? ?\d+)$", re.IGNORECASE),
)


def split_labels(table: Table, labels: Sequence[str] | None = None) -> list[tuple[str, Table]]:
    """Return (label, table) of the runs that stand beside one another.

    Their columns are known by a label in the name ("Time (s) Run #1", "Run 1: Time (s)"), or by labels, one for each
    column, where every one has the same columns and its own time. A column without a label belongs to all. One run of
    an empty label where there are none.
    """
    names = [str(name) for name in table.columns]
    found = list(labels) if labels is not None else []
    if labels is None:
        for at, name in enumerate(names):
            match = next((match for one in _LABELS if (match := one.match(name))), None)
            found.append(match["label"] if match else "")
            names[at] = match["name"] if match else name
    order = list(dict.fromkeys(label for label in found if label))
    runs = []
    for label in order:
        own = [at for at, one in enumerate(found) if one == label]
        both = [at for at, one in enumerate(found) if one in (label, "")]
        part = table.iloc[:, both].set_axis(pd.Index([names[at] for at in both]), axis=1)
        runs.append((label, part[table.iloc[:, own].notna().any(axis=1).to_numpy()]))
    return runs or [("", table)]


def repeats_itself(labels: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether every label stands over the same names, a time among them: then each is a run of its own."""
    groups = {label: [n for one, n in zip(labels, names, strict=True) if one == label] for label in labels}
    first = groups[labels[0]]
    same = all(group == first for group in groups.values())
    return len(groups) > 1 and same and "" not in groups and any(map(is_time_name, first))
