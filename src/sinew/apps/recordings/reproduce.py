"""`sinew reproduce`, `report` and `answer`: the paper's campaign on the twin, its pages, and its open questions."""

import shlex
import textwrap
import time
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps import console
from sinew.apps.console import Json, Rig, Seed, option
from sinew.apps.recordings import stored
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.estimate import number, shown_interval

if TYPE_CHECKING:
    import xarray as xr

    from sinew.measure.tasks import Hand
    from sinew.paper.answers.answer import Answer
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec


@dataclass(frozen=True)
class _Campaign:
    """Everything that the pages of a campaign are made from.

    beyond: results of a sweep above the paper's 12 mm, or None. rig: None where none is known.
    effects: what each effect of the twin adds, see `sinew.paper.summary`; empty where it was not measured.
    rebuild: the command that makes all of it again.
    """

    recording: "xr.Dataset"
    results: "xr.Dataset"
    beyond: "xr.Dataset | None"
    rig: "RigSpec | None"
    effects: list[dict[str, Any]]
    simulated_s: float
    rebuild: str


def reproduce(
    plan: Annotated[str, option("PLAN", "A plan: a file or a shipped name.")] = "paper",
    rig: Rig = "paper",
    out: Annotated[Path, option("DIR", "Folder for everything that is written.")] = Path("out/reproduce"),
    seed: Seed = 0,
    beyond: Annotated[
        str | None, option("PLAN", "A sweep above 12 mm for the paper's threshold; `beyond` with plan `paper`.")
    ] = None,
    json: Json = False,
) -> None:
    """Run the paper's campaign on the physics twin and set its numbers beside the paper's.

    Writes recording.nc, results.nc, figures/, report.html and summary.json, and beyond.nc, the results of the sweep
    above the paper's range.
    """
    from sinew.plan.toml import load_plan, load_rig

    began = time.monotonic()
    if beyond is None and plan == "paper":
        beyond = "beyond"
    plans, rig_ = [load_plan(name) for name in (plan, beyond) if name is not None], load_rig(rig)
    console.require_own(out, "recording.nc", _is_reproduced)
    command = ["sinew", "reproduce", "--plan", plan, "--rig", rig, "--seed", str(seed), "--out", str(out)]
    rebuild = shlex.join(command + (["--beyond", beyond] if beyond is not None and plan != "paper" else []))
    with _processes() as hand:
        campaign = _run_campaign(plans, rig_, seed, out, rebuild, hand)
        summary = _write_pages(campaign, out, hand, began=began)
    _show(summary, out, json=json)


def _is_reproduced(recording: Path) -> bool:
    """Return whether a recording is one that `sinew reproduce` made, and makes again."""
    from sinew.measure.files.netcdf import load_recording

    try:
        return str(load_recording(recording).attrs.get("command", "")).startswith("sinew reproduce ")
    except SinewError:
        return False


def _run_campaign(plans: "list[Plan]", rig: "RigSpec", seed: int, out: Path, rebuild: str, hand: "Hand") -> _Campaign:
    """Return the campaign of the first plan, its results written to a folder.

    What does not wait for the campaign is handed over, and so is that writing. plans: the second, if there is one, is
    the sweep beyond.
    """
    hand(_load, *_PAGES)
    from sinew.measure.files.netcdf import save_dataset, save_recording
    from sinew.measure.tasks import fetch_all
    from sinew.plan.check import refuse_beyond_limits
    from sinew.predict.preview import preview_plan
    from sinew.solve.programs import use_all_cores
    from sinew.twin.simulate import simulate

    use_all_cores()
    previews = [preview_plan(each, rig) for each in plans]
    for preview in previews:
        refuse_beyond_limits(preview)
    shares = hand(_effects, plans[0], rig)
    above = [hand(_results, each, rig, seed) for each in plans[1:]]
    with console.progress_bar("simulate") as progress:
        recording = simulate(plans[0], rig, seed=seed, progress=progress).assign_attrs(command=rebuild)
    for name in ("results.nc", "beyond.nc", "effects.json"):
        (out / name).unlink(missing_ok=True)
    save_recording(recording, out / "recording.nc")
    results = _analyse(recording, rig)
    try:
        with console.progress_bar("simulate above the paper's range, and with effects off"):
            further = next((results_of() for results_of in above), None)
            effects = shares()
        if effects:
            console.write_json(effects, out / "effects.json")
            results = results.assign_attrs(effects_hash=stored.hash_file(out / "effects.json"))
    except BaseException:  # an interrupt as well: what was computed is kept
        with suppress(FileError):
            save_dataset(results, out / "results.nc")
        raise
    files = {"results.nc": results} | ({} if further is None else {"beyond.nc": further})
    written = [hand(save_dataset, dataset, out / name) for name, dataset in files.items()]
    _load(*_PAGES)
    fetch_all(written)
    simulated_s = sum(preview.duration_s for preview in previews)
    return _Campaign(recording, results, further, rig, effects, simulated_s, rebuild)


_PAGES = "sinew.paper.report", "sinew.paper.summary"
"""Modules that draw and write, half a second to load."""


def _processes(at_most: int = 4) -> "AbstractContextManager[Hand]":
    """Give what hands calls to the processes beside this one, where there are cores for them; this one counts."""
    from sinew.measure.tasks import beside, cores

    return beside(min(at_most, cores()) - 1)


def _load(*modules: str) -> None:
    """Load what a process beside needs, while this one looks at what it is asked."""
    for name in modules:
        import_module(name)


def _results(plan: "Plan", rig: "RigSpec", seed: int) -> "xr.Dataset":
    """Return the results of a plan on the twin."""
    from sinew.analysis.analysed import analyse_with
    from sinew.twin.simulate import simulate

    return analyse_with(simulate(plan, rig, seed=seed), rig)


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with a recording.nc.")],
    rig: Annotated[str | None, option("RIG", "A rig; else the recording's.")] = None,
    json: Json = False,
) -> None:
    """Write figures, summary and report of a recording anew, from the files in its folder.

    Results that were made from another recording or with another rig are made anew. A recording that names no rig
    needs none: then nothing is said of stiffness and damping constants, and sensors are taken as perfect. A recording
    of a resonance that was tracked gives its table and figure, on a page.
    """
    from sinew.analysis.analysed import recording_rig
    from sinew.measure.files.netcdf import load_recording

    if not (folder / "recording.nc").is_file():
        raise FileError(f"found no recording.nc in {folder}; expected a folder that sinew simulate or reproduce wrote")
    began = time.monotonic()
    recording = load_recording(folder / "recording.nc")
    rig_ = recording_rig(recording, rig)
    console.require_folder(folder)
    if set(map(str, recording["kind"].values)) <= {"tracking", "idle"}:
        _report_tracking(recording, rig, folder, json=json)
        return
    results = stored.stored_results(folder / "results.nc", recording, rig_)
    before = {} if results is None else stored.stored_times(folder / "summary.json")
    if results is None:
        results = _analyse(recording, rig_, folder)
    steps = recording["time_s"].diff("sample")
    campaign = _Campaign(
        recording,
        results,
        stored.stored_beyond(folder / "beyond.nc", rig_),
        rig_,
        stored.stored_effects(folder / "effects.json", results),
        before.get("simulated_s", float(steps.median()) * recording.sizes["sample"]),
        _rebuild(recording, folder, rig),
    )
    with _processes() as hand:
        summary = _write_pages(campaign, folder, hand, began=began, wall_s=before.get("wall_s"))
    _show(summary, folder, json=json)


def _report_tracking(recording: "xr.Dataset", rig: str | None, folder: Path, *, json: bool) -> None:
    """Write table, figure and page of a recording of nothing but tracked motions."""
    from sinew.analysis.analysed import analyse
    from sinew.figures.tuned import save_tracking, write_tracking_page

    found = analyse(recording, rig)
    document = found.document["tracking"]
    figures = save_tracking(document, folder / "figures")
    page = write_tracking_page(folder / "report.html", document, figures, _rebuild(recording, folder, rig))
    console.print_result(found.document, found.told(), f"report: {page}", json=json)


def _rebuild(recording: "xr.Dataset", folder: Path, rig: str | None) -> str:
    """Return what makes all of a folder again: the command that made its recording, and `report` where that is more."""
    made = str(recording.attrs.get("command", ""))
    if made.startswith("sinew reproduce ") and rig is None:
        return made
    again = shlex.join(["sinew", "report", str(folder), *(("--rig", rig) if rig is not None else ())])
    return f"{made} && {again}" if made else again


def _effects(plan: "Plan", rig: "RigSpec") -> list[dict[str, Any]]:
    """Return the share of each effect; empty for a plan of other pretensions."""
    from sinew.paper.summary import SHARE_PRETENSIONS_MM, effect_shares

    return effect_shares(rig) if set(SHARE_PRETENSIONS_MM) <= set(plan.pretension.pretension_mm) else []


def _analyse(recording: "xr.Dataset", rig: "RigSpec | None", folder: Path | None = None) -> "xr.Dataset":
    """Return the results of a recording, also written to results.nc where a folder is given."""
    from sinew.analysis.analysed import analyse_with
    from sinew.measure.files.netcdf import save_dataset

    with console.progress_bar("analyse"):
        results = analyse_with(recording, rig)
    if folder is not None:
        save_dataset(results, folder / "results.nc")
    return results


def _write_pages(
    campaign: _Campaign, folder: Path, hand: "Hand", *, began: float, wall_s: float | None = None
) -> dict[str, Any]:
    from sinew.paper.report import draw_figures, write_report
    from sinew.paper.summary import summarise

    with console.progress_bar("draw"):
        figures = draw_figures(campaign.recording, campaign.results, folder / "figures", hand=hand)
        elapsed = wall_s if wall_s is not None else time.monotonic() - began
        summary = summarise(
            campaign.results, wall_s=elapsed, simulated_s=campaign.simulated_s, beyond=campaign.beyond, rig=campaign.rig
        )
        console.write_json(summary, folder / "summary.json")
        write_report(
            folder,
            results=campaign.results,
            figures=figures,
            summary=summary,
            beyond=campaign.beyond,
            rig=campaign.rig,
            determination=_determination(campaign.rig),
            effects=campaign.effects,
            answers=stored.stored_answers(folder / "answers.json", campaign.recording),
            rebuild=campaign.rebuild,
        )
    return summary


def _determination(rig: "RigSpec | None") -> dict[str, dict[str, Any]] | None:
    """Return how far the parameters of a shipped rig can move; None for any other rig, even one of the same name."""
    from sinew.plan.toml import list_shipped, load_rig, read_ranges

    if rig is None or rig.name not in list_shipped("rigs") or load_rig(rig.name) != rig:
        return None
    return read_ranges(rig.name)


def _show(summary: dict[str, Any], folder: Path, *, json: bool) -> None:
    from sinew.paper.table import count_roles

    if json:
        console.print_json(summary)
        return
    rows = [
        (
            str(row["quantity"]),
            _number(row["paper"]),
            _number(row["measured"]),
            _number(row["tolerance"]),
            "yes" if row["ok"] else "NO",
            str(row["role"]),
            str(row["where"]),
        )
        for row in summary["paper"]
    ]
    if rows:
        head = ("quantity", "paper", "measured", "tolerance", "ok", "role", "where")
        console.print_table(head, rows, "paper against measured")
        print(count_roles(summary["paper"]))
    _show_resonances(summary)
    _show_windows(summary)
    print(f"{summary['simulated_s']:.0f} s of motion, {summary['wall_s']:.0f} s of work")
    print(f"report: {folder / 'report.html'}")


def _show_resonances(summary: dict[str, Any]) -> None:
    rows = summary["resonance"]["rows"]
    if not rows:
        return
    names = [name for name in _RESONANCES if any(row.get(name) for row in rows)]
    head = ("pretension/mm", *(_RESONANCES[name] for name in names))
    cells = [(number(row["pretension_mm"]), *(shown_interval(row.get(name)) for name in names)) for row in rows]
    console.print_table(head, cells, "resonance in Hz, by what is meant (90 % interval)")


_RESONANCES = {
    "paper_resonance_hz": "mean of peaks (Eq. 6)",
    "resonance_hz": "fundamental",
    "resonance_measured_drive_hz": "by measured drive",
    "phase_90_hz": "90° of lag",
}


def _show_windows(summary: dict[str, Any]) -> None:
    from sinew.figures.page import WINDOW_HEAD, window_cells

    rows = summary["decay_windows"]["rows"]
    if not rows:
        return
    ends = [(0, rows[0]["pretension_mm"][0]), (-1, rows[0]["pretension_mm"][-1])]
    head = ("start/periods", *(f"D at {mm:g} mm" for _, mm in ends), *WINDOW_HEAD)
    cells = [
        (
            number(row["start_periods"]),
            *(shown_interval(row["lehr_damping"][end]) for end, _ in ends),
            *(cell.replace("−", "-") for cell in window_cells(row)),
        )
        for row in rows
    ]
    console.print_table(head, cells, "Lehr's damping over pretension, by where the decay begins after the stop")
    print(textwrap.fill(summary["decay_windows"]["conclusion"], 120))


def _number(value: Any) -> str:
    return number(value) if isinstance(value, int | float) and not isinstance(value, bool) else str(value or "")


# The paper's open questions are asked of a recording.


def answer(
    file: Annotated[
        Path, typer.Argument(metavar="RECORDING|RIG", help="A recording of Sinew (NetCDF), or a rig: file or name.")
    ],
    out: Annotated[
        Path | None, option("DIR", "Folder for the page; by default a recording's own, and none for a rig.")
    ] = None,
    rig: Annotated[str | None, option("RIG", "A rig; else the recording's.")] = None,
    azimuth: Annotated[
        float | None,
        option("DEG", "Of a rig: where it bends to, from y towards z; else 90.", "--azimuth-deg"),
    ] = None,
    json: Json = False,
) -> None:
    """Answer the paper's open questions from a recording or a rig: numbers with intervals, and what cannot be told.

    It writes answers.html, answers.json and the figures of the answers. Of a recording, results.nc and beyond.nc beside
    it are taken up where they belong to it; a whole campaign takes about half a minute. Of a rig it answers what
    nobody has measured, in a minute or two: whether a bend moves the resonance, what moves with the torsion, how
    unequal tensions get, the spinal engine, what the joint carries, and how a bench would test each.
    """
    if _is_rig(file):
        _answer_rig(file, out, rig, azimuth, json=json)
        return
    if azimuth is not None:
        raise SpecError("found --azimuth-deg beside a recording, which holds its pose; give it with a rig")
    if not file.is_file():
        raise FileError(
            f"found no recording {file}; expected a file that sinew simulate, run, import or reproduce wrote"
        )
    folder = console.require_folder(out if out is not None else file.parent)
    command = ["sinew", "answer", str(file), *(["--out", str(out)] if out is not None else [])]
    command += ["--rig", rig] if rig is not None else []
    with _processes(2) as hand:
        answers, document = _answer_recording(file, folder, rig, shlex.join(command), hand)
    if json:
        console.print_json(document)
    else:
        _print_answers(answers)
        print(f"page: {folder / 'answers.html'}")


def _answer_recording(
    file: Path, folder: Path, rig: str | None, rebuild: str, hand: "Hand"
) -> "tuple[list[Answer], dict[str, Any]]":
    """Return the answers of a recording, written to a folder, and the document of them."""
    from sinew.analysis.analysed import recording_rig
    from sinew.measure.files.netcdf import load_recording

    recording = load_recording(file)
    rig_ = recording_rig(recording, rig)
    hand(_load, "sinew.paper.answers.questions")
    from sinew.paper.answers.questions import answer_questions
    from sinew.solve.programs import use_all_cores

    use_all_cores()
    results = stored.stored_results(file.parent / "results.nc", recording, rig_)
    if results is None:
        results = _analyse(recording, rig_)
    with console.progress_bar("answer") as progress:
        answers = answer_questions(
            recording,
            results,
            rig_,
            beyond=stored.stored_beyond(file.parent / "beyond.nc", rig_),
            hand=hand,
            progress=lambda _step, done, total: progress(done, total),
        )
    return answers, _write_answers(answers, recording, rig_, folder, rebuild, hand)


def _is_rig(file: Path) -> bool:
    from sinew.plan.toml import list_shipped

    return file.suffix == ".toml" or (not file.exists() and str(file) in list_shipped("rigs"))


def _answer_rig(file: Path, out: Path | None, rig: str | None, azimuth: float | None, *, json: bool) -> None:
    if rig is not None:
        raise SpecError(f"found --rig {rig} beside the rig {file}; expected one of them, or a recording with --rig")
    if azimuth is not None:
        console.checked_number("--azimuth-deg", azimuth, "an angle from -360 to 360°", low=-360, high=360)
    if out is not None:
        console.require_folder(out)
    from sinew.paper.answers.of_rig import AZIMUTH_DEG, CAPTIONS, answer_rig, draw_rig_answers
    from sinew.plan.toml import load_rig

    rig_, azimuth_deg = load_rig(str(file)), AZIMUTH_DEG if azimuth is None else azimuth
    with console.progress_bar("answer") as progress:
        answers = answer_rig(rig_, azimuth_deg=azimuth_deg, progress=progress)
    document = {
        "recording_hash": None,
        "rig": rig_.name,
        "azimuth_deg": azimuth_deg,
        "answers": [one.to_json() for one in answers],
    }
    if out is not None:
        from sinew.paper.report import write_rig_answers

        with console.progress_bar("draw") as progress:
            figures = draw_rig_answers(answers, rig_, out / "figures", azimuth_deg=azimuth_deg, progress=progress)
        console.write_json(document, out / "answers.json")
        command = ["sinew", "answer", str(file), "--out", str(out)]
        command += [] if azimuth is None else ["--azimuth-deg", f"{azimuth:g}"]
        write_rig_answers(out, answers, rig_, captions=CAPTIONS, figures=figures, rebuild=shlex.join(command))
    if json:
        console.print_json(document)
        return
    _print_answers(answers, all_of_it=True)
    if out is not None:
        print(f"page: {out / 'answers.html'}")


def _write_answers(
    answers: "list[Answer]", recording: "xr.Dataset", rig: "RigSpec | None", folder: Path, rebuild: str, hand: "Hand"
) -> dict[str, Any]:
    from sinew.measure.files.netcdf import content_hash
    from sinew.paper.answers.questions import draw_answers
    from sinew.paper.report import write_answers

    figures = draw_answers(answers, folder / "figures", hand=hand)
    document = {
        "recording_hash": str(recording.attrs.get("content_hash") or content_hash(recording)),
        "rig": "" if rig is None else rig.name,
        "answers": [one.to_json() for one in answers],
    }
    console.write_json(document, folder / "answers.json")
    write_answers(folder, answers, recording=recording, figures=figures, rebuild=rebuild)
    return document


def _print_answers(answers: "list[Answer]", *, all_of_it: bool = False) -> None:
    """Print questions and verdicts, then what they rest on: two sentences of each, or all under its question."""
    console.print_table(("question", "answer"), [(one.question, one.verdict) for one in answers])
    for one in answers:
        if all_of_it:
            print(f"\n{one.question}")
        for sentence in one.sentences if all_of_it else one.sentences[:2]:
            print(textwrap.fill(sentence, 100, initial_indent="- ", subsequent_indent="  "))
