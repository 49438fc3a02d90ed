"""The command `sinew runs`: a folder of runs as a table, searched, and what has changed over months."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from sinew.apps import console
from sinew.apps.console import Json, flag, option
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.result import Rows, Table, plain


def runs(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder of runs, one folder each.")],
    search: Annotated[str, option("WORDS", 'Words and ranges, as "aged f_r=3..3.4 pretension=6".')] = "",
    trend: Annotated[str | None, option("QUANTITY", "How f_r, D, gain or another one changed over months.")] = None,
    most: Annotated[int, option("N", "So many runs are listed, the newest.", "--most", min=1)] = 50,
    analyse: Annotated[bool, flag("--analyse", "Analyse first what has no results yet; takes seconds each.")] = False,
    out: Annotated[Path | None, option("FILE", "With --trend: .svg, .png or .pdf, or a page, .html.")] = None,
    json: Json = False,
) -> None:
    """List the runs of a folder, search them by words and numbers, and say what has changed over months.

    Of each run: begin, rig, plan, state with its reason, and resonance f_r, Lehr's damping D and gain with 90 %
    intervals. An index beside the runs (.index.json in DIR) is brought up to date first: only what changed is read, and
    no recording is. A word begins one in name, date (2026-03), rig, plan, source, state or reason. Ranges of
    numbers (f_r, D, gain, f_90, width, k, d ...) as f_r=3..3.4, f_r=3.2.. or pretension=6 hold at one and the same
    pretension.
    """
    from sinew.analysis.runs import parse_search, quantity_of, trends
    from sinew.apps.dashboard.work.runs import index_of

    parse_search(search)  # what is wrong with it is said before anything is read
    quantity = None if trend is None else quantity_of(trend)
    if out is not None:
        if quantity is None:
            raise SpecError("--out draws a trend; name what with --trend, as in --trend f_r")
        console.require_ending(out, (*console.PICTURES, ".html"))
    if not folder.is_dir():
        raise FileError(f"there is no folder {folder}; name one that holds folders of runs")
    index = index_of(folder)
    with console.progress_bar("run") as progress:
        left = index.refresh(progress=progress)
    if analyse:
        _analyse(folder, [row["name"] for row in index.search(search) if row.get("remark")])
        index.refresh()
    found = index.search(search)
    if left:
        console.remark(f"{left} folders are left out, whose names are no UTF-8")
    about = {"search": search, "count": len(found)}
    if quantity is None:
        console.print_result(about | {"runs": found[:most]}, _listed(found[:most]), json=json)
        if len(found) > most:
            console.remark(f"the newest {most} of {len(found)} runs; --most lists more")
        return
    made = Rows(trends(found, quantity))
    if not made:
        said = f"no run that is found has {quantity}; search for others, or analyse them with --analyse"
        if out is not None:
            raise SpecError(said)
        console.remark(said)
    elif out is not None:
        from sinew.figures.page import save_trends

        save_trends(made, out)
    blocks = [table] if (table := made.table()) else []
    sentences = [f"{one.title}: {one.sentence}" for one in made]
    console.print_result(about | {"trends": plain(made)}, [*blocks, *sentences], json=json)


def _analyse(folder: Path, names: Sequence[str]) -> None:
    from sinew.apps.dashboard.work.results import run_results

    with console.progress_bar("run") as progress:
        for done, name in enumerate(names, start=1):
            try:
                run_results(folder / name)
            except SinewError as trouble:
                console.remark(f"{name} is not analysed: {trouble}")
            progress(done, len(names))


def _listed(found: Sequence[Mapping[str, Any]]) -> list[Table | str]:
    """Return the table of runs, why some ended early or are damaged, and what is to be done about others."""
    from sinew.analysis.runs import COMMON, QUANTITIES
    from sinew.measure.estimate import number, shown_interval

    rows = []
    for run in found:
        first = [run["name"], (run.get("started") or "–")[:16], run.get("rig") or "–", run.get("plan") or "–"]
        first.append(run["state"])
        for row_number, row in enumerate(run["found"] or [{}]):
            numbers = [shown_interval(row.get(one)) for one in COMMON]
            rows.append([*(first if not row_number else [""] * len(first)), number(row.get("pretension_mm")), *numbers])
    heads = ("run", "begin", "rig", "plan", "state", "mm", *(QUANTITIES[one].head("/") for one in COMMON))
    why = [f"{run['name']}: {run['sentence']}" for run in found if run["state"] in ("stopped", "damaged")]
    if left := sum(bool(run.get("remark")) for run in found):
        why.append(f"{left} of these have no results yet; --analyse makes them.")
    return [Table(heads, rows), *why] if rows else ["No run is found."]
