"""Mutations of the physics, the analysis and the bench: which of them do the fast tests notice?

Each mutation is one change of one place, drawn at random with a seed: a sign, a factor of two, an off-by-one, two
neighbours swapped, a guard that is dropped. It is made in a copy of the tree, where of `make test`'s selection those
files of tests run that call the mutated function, the likeliest and quickest first, until one fails; all, where the
place is run when its module is imported. Which those are is found at the start, by one run of the selection. A mutation
that no test notices is printed with its place: read it, it may change nothing that anybody sees, or a test is missing.

One that changes nothing that anybody can see is written down in `EQUIVALENT`, with the reason. Whatever the seed, a
draw that meets it is printed and does not count: the drawing goes on until there are as many as were asked for.

`--rooms` draws from some rooms only; `--named` begins with the mutations of `NAMED`, which no test had noticed once;
`--tests` runs a part of the selection, so that more may go unnoticed than by all of it, never fewer.
"""

import ast
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import repeat
from pathlib import Path

from campaigns.options import campaign_parser
from campaigns.touched import Calls, calls_of

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("mechanics", "solve", "analysis", "identify", "bench", "hardware", "emulator")
KINDS = ("sign", "factor of two", "off by one", "swapped", "dropped guard")
_START_S, _LONGER = 300.0, 5.0
"""A run that takes so much, and so many times as long as its files without mutation, has noticed: something waits."""

_PYTEST = [sys.executable, "-B", "-m", "pytest", "-q", "-p", "no:cacheprovider", "--no-header", "-rfE"]
_PYTEST += ["-m", "not slow and not hardware"]
_OTHER = {ast.Add: "-", ast.Sub: "+"}


@dataclass(frozen=True)
class Mutation:
    """One change: of a file under src/sinew, the text between two offsets of it becomes another."""

    kind: str
    file: str
    line: int
    begin: int
    end: int
    before: str
    after: str

    def made(self, text: str) -> str:
        """Return the file's text with the change."""
        assert text[self.begin : self.end] == self.before
        return text[: self.begin] + self.after + text[self.end :]


NAMED = (
    ("hardware/motor.py", 'self.sign * (self.state()["present_position"]', '(self.state()["present_position"]'),
    ("bench/stops.py", "DRIVE_HOLD_SHARE = 0.2", "DRIVE_HOLD_SHARE = 1.0"),
    ("bench/guard.py", "abs(motor.current), limits.tendon_current_a", "motor.current, limits.tendon_current_a"),
    ("bench/guard.py", "low <= climate.voltage <= high", "low <= climate.voltage"),
    ("hardware/bus.py", "wait = self._clock.now() + quiet", "wait = self._clock.now()"),
    (
        "hardware/configuration.py",
        'Row("velocity_i_gain", _initial("velocity_i_gain"), "as from the factory"),\n'
        '    Row("velocity_p_gain", _initial("velocity_p_gain")',
        'Row("velocity_i_gain", _initial("velocity_p_gain"), "as from the factory"),\n'
        '    Row("velocity_p_gain", _initial("velocity_i_gain")',
    ),
)
"""Changes of the bench by file below src/sinew, text and its replacement."""

EQUIVALENT = {
    (
        "emulator/joint_plant.py",
        "self._laws = [Law()] * (count + 1)",
        "self._laws = [Law()] * (count + 2)",
    ): "the list is read and written by the number of a motor alone, of which there are count + 1",
    (
        "bench/record/conversion.py",
        "dx, dy = x - mean_x, y - mean_y",
        "dx, dy = x - mean_x, y + mean_y",
    ): "the weighted sum of dx is zero, so a constant added to dy leaves the slope as it is",
    (
        "emulator/rig.py",
        "self.due = min(self.due, now + _STEP)",
        "self.due = min(self.due, now - _STEP)",
    ): "a trip is looked at once more, at its own moment, when the horn has turned by nothing yet",
}
"""Why a mutation changes nothing that anybody can see, by file, the line that it changes, and the line as changed."""


def named(root: Path = ROOT) -> list[Mutation]:
    """Return the mutations of `NAMED`. Raises SystemExit where the text of one is no longer there, or not once."""
    found = []
    for file, before, after in NAMED:
        text = (root / "src/sinew" / file).read_text(encoding="utf-8")
        if (count := text.count(before)) != 1:
            raise SystemExit(f"{file} has {count} places like {before!r}, expected one; correct NAMED")
        begin = text.index(before)
        line = text.count("\n", 0, begin) + 1
        found.append(Mutation("named", file, line, begin, begin + len(before), before, after))
    return found


def _why_equivalent(mutation: Mutation, root: Path) -> str:
    """Return why a mutation changes nothing that anybody can see; empty where that is not known."""
    text = (root / "src/sinew" / mutation.file).read_text(encoding="utf-8")
    before, after = (whole.splitlines()[mutation.line - 1].strip() for whole in (text, mutation.made(text)))
    return EQUIVALENT.get((mutation.file, before, after), "")


def _offsets(text: str) -> list[int]:
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    return starts


class _Finder(ast.NodeVisitor):
    """Collects what can be changed in one module; words, annotations and export lists are left alone."""

    def __init__(self, file: str, text: str) -> None:
        self.file, self.raw, self.starts = file, text.encode(), _offsets(text)
        self.found: list[Mutation] = []

    def _at(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        begin = self.starts[node.lineno - 1] + node.col_offset
        return begin, self.starts[node.end_lineno - 1] + node.end_col_offset

    def _add(self, kind: str, line: int, begin: int, end: int, after: str) -> None:
        before = self.raw[begin:end].decode()
        shift = len(self.raw[:begin].decode())  # of characters: the module has more than ASCII
        if before != after:
            self.found.append(Mutation(kind, self.file, line, shift, shift + len(before), before, after))

    def _text(self, node: ast.expr) -> str:
        begin, end = self._at(node)
        return self.raw[begin:end].decode()

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_arguments(self, node: ast.arguments) -> None:
        for default in (*node.defaults, *node.kw_defaults):
            if default is not None:
                self.visit(default)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self.visit(node.args)
        for statement in node.body:
            self.visit(statement)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Leave sentences alone."""

    def visit_Raise(self, node: ast.Raise) -> None:
        """Leave sentences alone."""

    def visit_BinOp(self, node: ast.BinOp) -> None:
        begin, end = self._at(node.left)[1], self._at(node.right)[0]
        if isinstance(node.op, ast.Add | ast.Sub) and not _is_text(node):
            old = "+" if isinstance(node.op, ast.Add) else "-"
            between = self.raw[begin:end].decode()
            if between.count(old) == 1:
                at = begin + len(between[: between.index(old)].encode())
                self._add("sign", node.lineno, at, at + 1, _OTHER[type(node.op)])
        if isinstance(node.op, ast.Mult | ast.Div) and not _is_text(node):
            whole_begin, whole_end = self._at(node)
            self._add("factor of two", node.lineno, whole_begin, whole_end, f"(2 * ({self._text(node)}))")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, int) and not isinstance(node.value, bool) and abs(node.value) < 100:
            self._add("off by one", node.lineno, *self._at(node), str(node.value + 1))

    def visit_Call(self, node: ast.Call) -> None:
        plain = [arg for arg in node.args if not isinstance(arg, ast.Starred)]
        if len(plain) == len(node.args) >= 2 and all(isinstance(arg, ast.Name | ast.Attribute) for arg in plain[:2]):
            first, second = plain[:2]
            begin, end = self._at(first)[0], self._at(second)[1]
            between = self.raw[self._at(first)[1] : self._at(second)[0]].decode()
            self._add("swapped", node.lineno, begin, end, self._text(second) + between + self._text(first))
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        if len(node.body) == 1 and isinstance(node.body[0], ast.Raise | ast.Return | ast.Continue) and not node.orelse:
            begin, end = self._at(node.test)
            self._add("dropped guard", node.lineno, begin, end, "False")
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)


def _is_text(node: ast.BinOp) -> bool:
    parts = (node.left, node.right)
    return any(
        isinstance(p, ast.JoinedStr) or (isinstance(p, ast.Constant) and isinstance(p.value, str)) for p in parts
    )


def mutations_of(file: str, text: str) -> list[Mutation]:
    """Return all mutations of a module's text."""
    finder = _Finder(file, text)
    finder.visit(ast.parse(text))
    return finder.found


def drawn(seed: int, count: int, rooms: Sequence[str] = ROOMS, root: Path = ROOT) -> list[Mutation]:
    """Return mutations drawn with a seed: rooms and kinds in turn, places at random, no place twice.

    Those in `EQUIVALENT` are printed and do not count.
    """
    rng = random.Random(seed)
    every: list[Mutation] = []
    for path in sorted((root / "src/sinew").rglob("*.py")):
        file = path.relative_to(root / "src/sinew").as_posix()
        if file.split("/")[0] in rooms:
            every += mutations_of(file, path.read_text(encoding="utf-8"))
    chosen: list[Mutation] = []
    seen: list[Mutation] = []
    while len(chosen) < count:
        room, kind = rooms[len(seen) % len(rooms)], KINDS[len(seen) % len(KINDS)]
        here = [m for m in every if m.file.startswith(f"{room}/") and m.kind == kind and m not in seen]
        seen.append(mutation := rng.choice(here))
        if why := _why_equivalent(mutation, root):
            print(f"passed over, {mutation.file}:{mutation.line}: {mutation.before!r} -> {mutation.after!r}: {why}")
        else:
            chosen.append(mutation)
    return chosen


def _function_at(text: str, line: int) -> int | None:
    """Return the first line of the innermost function whose body has a line; None where importing runs it."""
    functions = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)]
    around = [node for node in functions if node.body[0].lineno <= line <= (node.end_lineno or 0)]
    if not around:
        return None
    inner = max(around, key=lambda node: node.lineno)
    return min([inner.lineno, *(decorator.lineno for decorator in inner.decorator_list)])


def tests_for(mutation: Mutation, tree: Path, calls: Calls) -> list[str]:
    """Return the files of tests that run a mutated place, those first that name its module, then the quickest."""
    text = (tree / "src/sinew" / mutation.file).read_text(encoding="utf-8")
    place = mutation.file, _function_at(text, mutation.line) or 0
    module = "sinew." + mutation.file.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
    by = calls.files.get(place, set()) if place[1] and place not in calls.every else set(calls.seconds)

    def rank(file: str) -> tuple[bool, float]:
        return module not in (tree / file).read_text(encoding="utf-8"), calls.seconds.get(file, math.inf)

    return sorted(by, key=rank)


def judged(mutation: Mutation, tree: Path, calls: Calls) -> tuple[str, float]:
    """Return (what noticed it or "", seconds) of a mutation made in a tree, which is as before afterwards."""
    path, tests = tree / "src/sinew" / mutation.file, tests_for(mutation, tree, calls)
    text, begin = path.read_text(encoding="utf-8"), time.monotonic()
    path.write_text(mutation.made(text), encoding="utf-8")
    try:
        noticed = failing(tree, tests, _START_S + _LONGER * sum(calls.seconds.get(file, 0.0) for file in tests))
    finally:
        path.write_text(text, encoding="utf-8")
    return noticed, time.monotonic() - begin


def failing(tree: Path, tests: Sequence[str], limit_s: float) -> str:
    """Return the first of some files' fast tests that fails, or what else went wrong; empty where none does."""
    if not tests:
        return ""
    command = [*_PYTEST, "-x", *tests]
    try:
        done = subprocess.run(
            command, cwd=tree, env=_environment(tree), capture_output=True, text=True, timeout=limit_s, check=False
        )
    except subprocess.TimeoutExpired:
        return f"no end within {limit_s:.0f} s"
    return _said(done.stdout) or ("" if done.returncode == 0 else f"status {done.returncode}")


def _said(printed: str) -> str:
    said = [line for line in printed.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return said[0].split(" - ")[0] if said else ""


def _environment(tree: Path) -> dict[str, str]:
    path = f"{tree / 'src'}{os.pathsep}{tree}"
    flags = "--xla_cpu_use_fusion_emitters=false"  # as the Makefile has them
    return os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "XLA_FLAGS": flags}


@contextmanager
def _copy() -> Iterator[Path]:
    """Give a copy of the tree with the shared recordings beside it."""
    with tempfile.TemporaryDirectory(prefix="mutated") as folder:
        tree = Path(folder) / "tree"
        listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
        for name in filter(lambda name: (ROOT / name).exists(), listed.stdout.splitlines()):
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name, follow_symlinks=False)
        if (ROOT.parent / "shared").is_dir():
            (Path(folder) / "shared").symlink_to((ROOT.parent / "shared").resolve())
        yield tree


def called(workers: int, tests: Sequence[str] = ()) -> Calls:
    """Return what the fast tests call, of one run; without any mutation none of them may fail.

    tests: files or folders of them; empty: all.
    """
    with _copy() as tree:
        command = [*_PYTEST, "-n", str(workers), "--dist", "loadfile", *tests]
        calls, printed = calls_of(tree, command, _environment(tree))
    if already := _said(printed):
        raise SystemExit(f"a test fails without any mutation: {already}; the campaign would prove nothing")
    if not calls.seconds:
        raise SystemExit(f"no test ran, pytest says: {printed[-2000:]}")
    return calls


def _share(mutations: Sequence[Mutation], calls: Calls) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    with _copy() as tree:
        for mutation in mutations:
            noticed, took_s = judged(mutation, tree, calls)
            place = f"{mutation.file}:{mutation.line}"
            change = f"{mutation.kind}, {place}: {mutation.before!r} -> {mutation.after!r}"
            print(f"{change}: {noticed or 'NOT NOTICED'} ({took_s:.0f} s)", flush=True)
            rows.append({**asdict(mutation), "noticed_by": noticed, "took_s": round(took_s, 1)})
    return rows


def main() -> int:
    """Run the campaign; each worker has a copy of the tree."""
    parser = campaign_parser("mutations", __doc__, count=30, of="mutations", numbered=True)
    parser.add_argument("--workers", type=int, default=2, help="copies of the tree side by side [2]")
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=ROOMS, help="of src/sinew [all of these]")
    parser.add_argument("--named", action="store_true", help="begin with those of NAMED")
    parser.add_argument("--tests", nargs="+", default=(), help="files or folders of tests [all]")
    asked = parser.parse_args()
    first = named() if asked.named else []
    count = max(0, asked.first + asked.mutations - len(first))
    chosen = [*first, *drawn(asked.seed, count, asked.rooms)][asked.first : asked.first + asked.mutations]
    calls = called(asked.workers, asked.tests)
    with ThreadPoolExecutor(asked.workers) as pool:
        shares = pool.map(_share, [chosen[i :: asked.workers] for i in range(asked.workers)], repeat(calls))
        rows = [row for share in shares for row in share]
    caught = sum(bool(row["noticed_by"]) for row in rows)
    print(f"{caught} of {len(rows)} noticed")
    if asked.out is not None:
        asked.out.parent.mkdir(parents=True, exist_ok=True)
        asked.out.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
