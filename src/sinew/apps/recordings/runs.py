"""The command `sinew runs`: a folder of runs as a table, searched, and what has changed over months."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from sinew.apps import console
from sinew.apps.console import Json, flag, option
from sinew.measure.errors import FileError, SinewError, SpecError

ENDINGS = (".svg", ".png", ".pdf", ".html")


def runs(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder of runs, one folder each.")],
    search: Annotated[str, option("QUERY", 'Words and conditions, as "f_r>3.2 pretension=6 tag:aged".')] = "",
    trend: Annotated[str | None, option("QUANTITY", "How f_r, D, gain or another one changed over months.")] = None,
    most: Annotated[int, option("N", "So many runs are listed, the newest.", "--most", min=1)] = 50,
    analyse: Annotated[bool, flag("--analyse", "Analyse first what has no results yet; takes seconds each.")] = False,
    out: Annotated[Path | None, option("FILE", "With --trend: .svg, .png or .pdf, or a page, .html.")] = None,
    json: Json = False,
) -> None:
    """List the runs of a folder, search them by words and numbers, and say what has changed over months.

    Of each run: begin, rig, plan, state with its reason, tags, and resonance f_r, Lehr's damping D and gain with 90 %
    intervals. An index beside the runs (.index in DIR) is brought up to date first: only what changed is read, and no
    recording is. Conditions on numbers (f_r, D, gain, f_90, width, k, d, pretension ...) take >, >=, <, <=, =, != and
    ranges as f_r=3..3.4, and hold at one and the same pretension; tag:, rig:, plan:, source:, state:, reason:, notes:,
    name: and begin>=2026-03 narrow it further, - before a word leaves out what has it.
    """
    from sinew.analysis.run_index import MOST_RUNS, parse_query, quantity_of
    from sinew.apps.dashboard.work.runs import index_of

    parse_query(search)  # what is wrong with it is said before anything is read
    quantity = None if trend is None else quantity_of(trend)
    if out is not None:
        if quantity is None:
            raise SpecError("--out draws a trend; name what with --trend, as in --trend f_r")
        if out.suffix not in ENDINGS:
            raise SpecError(
                f"--out is {out}, expected a name that ends with {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
            )
        console.require_file(out)
    if not folder.is_dir():
        raise FileError(f"there is no folder {folder}; name one that holds folders of runs")
    with index_of(folder) as index:
        with console.progress_bar("run") as progress:
            refreshed = index.refresh(progress=progress)
        if analyse:
            _analyse(folder, [row["name"] for row in index.search(search) if row.get("remark")])
            index.refresh()
        count = index.count(search)
        found = index.search(search, most=most if quantity is None else None)
    if refreshed.left:
        console.remark(
            f"{refreshed.left} folders are left out: beyond the {MOST_RUNS} that an index takes, or named in no UTF-8"
        )
    if quantity is None:
        _tell_runs(found, count, search, json)
    else:
        _tell_trend(found, quantity, count, search, out, json)


def _analyse(folder: Path, names: Sequence[str]) -> None:
    from sinew.apps.dashboard.work.results import run_results

    with console.progress_bar("run") as progress:
        for done, name in enumerate(names, start=1):
            try:
                run_results(folder / name)
            except SinewError as trouble:
                console.remark(f"{name} is not analysed: {trouble}")
            progress(done, len(names))


def _tell_runs(found: Sequence[Mapping[str, Any]], count: int, search: str, json: bool) -> None:
    from sinew.analysis.run_index import COMMON, QUANTITIES
    from sinew.measure.estimate import number

    if json:
        console.print_json({"search": search, "count": count, "runs": list(map(_document, found))})
        return
    heads = [
        f"{QUANTITIES[one].called[0]}{f'/{QUANTITIES[one].unit}' if QUANTITIES[one].unit else ''}" for one in COMMON
    ]
    rows = []
    for run in found:
        first = [run["name"], (run.get("started") or "–")[:16], run.get("rig") or "–", run.get("plan") or "–"]
        first += [run["state"], " ".join(run.get("tags") or [])]
        for place, row in enumerate(run["found"] or [{}]):
            numbers = [_shown(row.get(one)) for one in COMMON]
            rows.append([*(first if not place else [""] * len(first)), number(row.get("pretension_mm")), *numbers])
    console.print_table(("run", "begin", "rig", "plan", "state", "tags", "mm", *heads), rows)
    for run in found:
        if run["state"] in ("stopped", "damaged"):
            print(f"{run['name']}: {run['sentence']}")
    left = sum(bool(run.get("remark")) for run in found)
    if left:
        console.remark(f"{left} of these have no results yet; --analyse makes them")
    if count > len(found):
        console.remark(f"the newest {len(found)} of {count} runs; --most lists more")
    if not found:
        console.remark("no run is found")


def _shown(estimate: Mapping[str, Any] | None) -> str:
    from sinew.measure.estimate import shown_interval

    return shown_interval(estimate)


_KEYS = ("name", "started", "rig", "plan", "source", "state", "sentence", "notes", "tags", "duration_s")
_MORE = ("groups_done", "groups", "bytes", "analysed", "remark", "found")


def _document(run: Mapping[str, Any]) -> dict[str, Any]:
    return {key: run.get(key) for key in (*_KEYS, *_MORE)}


def _tell_trend(
    found: Sequence[Mapping[str, Any]], quantity: str, count: int, search: str, out: Path | None, json: bool
) -> None:
    from sinew.analysis.run_trend import DAYS_OF_A_MONTH, trends
    from sinew.measure.estimate import UNKNOWN, number

    made = trends(found, quantity)
    if out is not None:
        if not made:
            raise SpecError(f"no run that is found has {quantity}; search for others, or analyse them with --analyse")
        from sinew.figures.page import save_trends

        save_trends(made, out)
    if json:
        console.print_json({"search": search, "count": count, "trends": [one.to_json() for one in made]})
        return
    rows = []
    for one in made:
        slope = UNKNOWN if one.line is None else one.line.slope.times(DAYS_OF_A_MONTH).shown_interval()
        between = UNKNOWN if one.line is None else number(one.line.between, 2)
        rows.append([one.title, str(len(one.runs)), slope, between])
    console.print_table(("of", "runs", f"{quantity} a month (90 %)", "between runs"), rows)
    for one in made:
        print(f"{one.title}: {one.sentence}")
    if not made:
        console.remark(f"no run that is found has {quantity}")
