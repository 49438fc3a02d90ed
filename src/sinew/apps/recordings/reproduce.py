"""`sinew reproduce` and `report`: the paper's campaign on the twin, its pages, its open questions and its film."""

import shlex
import textwrap
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sinew.apps import console
from sinew.apps.console import Json, Rig, Seed, flag, option
from sinew.apps.recordings import stored
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.estimate import number

if TYPE_CHECKING:
    import xarray as xr

    from sinew.figures.motion import FilmKind
    from sinew.paper.answer import Answer
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec


@dataclass(frozen=True)
class _Campaign:
    """Everything that the pages of a campaign are made from.

    beyond: results of a sweep above the paper's 12 mm, or None. rig: None where none is known.
    effects: what each effect of the twin adds, see `sinew.paper.campaign`; empty where it was not measured.
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
    context: typer.Context,
    plan: Annotated[str, option("PLAN", "A plan: a file or a shipped name.")] = "paper",
    rig: Rig = "paper",
    out: Annotated[Path, option("DIR", "Folder for everything that is written.")] = Path("out/reproduce"),
    seed: Seed = 0,
    beyond: Annotated[
        str | None, option("PLAN", "A sweep above 12 mm for the paper's threshold; `beyond` with plan `paper`.")
    ] = None,
    json: Json = False,
) -> None:
    """Run the paper's campaign on the twin, with a report.

    Its numbers are set beside the paper's. Writes recording.nc, results.nc, figures/, report.html and summary.json,
    and beyond.nc, the results of the sweep above the paper's range.
    """
    from sinew.plan.toml import load_plan, load_rig

    began = time.monotonic()
    if beyond is None and plan == "paper":
        beyond = "beyond"
    plans, rig_ = [load_plan(name) for name in (plan, beyond) if name is not None], load_rig(rig)
    console.require_own(out, "recording.nc", _is_reproduced)
    campaign = _run_campaign(plans, rig_, seed, out, console.command_line(context))
    summary = _write_pages(campaign, out, began=began)
    if json:
        console.print_json(summary)
    else:
        _show(summary, campaign.results, out)


def _is_reproduced(recording: Path) -> bool:
    """Return whether a recording is one that `sinew reproduce` made, and makes again."""
    from sinew.measure.files.netcdf import load_recording

    try:
        return str(load_recording(recording).attrs.get("command", "")).startswith("sinew reproduce ")
    except SinewError:
        return False


def _run_campaign(plans: "list[Plan]", rig: "RigSpec", seed: int, out: Path, rebuild: str) -> _Campaign:
    """Return the campaign of the first plan, its results written to a folder.

    Processes of their own simulate what does not wait for the campaign. plans: the second, if there is one, is the
    sweep beyond.
    """
    from sinew.measure.files.netcdf import save_dataset, save_recording
    from sinew.measure.tasks import cores, process_pool
    from sinew.plan.check import refuse_beyond_limits
    from sinew.predict.preview import preview_plan
    from sinew.solve.programs import use_all_cores
    from sinew.twin.simulate import simulate

    use_all_cores()
    previews = [preview_plan(each, rig) for each in plans]
    for preview in previews:
        refuse_beyond_limits(preview)
    processes = max(1, min(_PARTS, cores() - 1))
    with process_pool(processes, cores() // (processes + 1)) as pool:
        shares = pool.submit(_effects, plans[0], rig)
        above = [pool.submit(_results, each, rig, seed) for each in plans[1:]]
        with console.progress_bar("simulate") as progress:
            recording = simulate(plans[0], rig, seed=seed, progress=progress).assign_attrs(command=rebuild)
        for name in ("results.nc", "beyond.nc", "effects.json"):
            (out / name).unlink(missing_ok=True)
        save_recording(recording, out / "recording.nc")
        results = _analyse(recording, rig)
        try:
            with console.progress_bar("simulate above the paper's range, and with effects off"):
                further = next((one.result() for one in above), None)
                effects = shares.result()
            if effects:
                console.write_json(effects, out / "effects.json")
                results = results.assign_attrs(effects_hash=stored.hash_file(out / "effects.json"))
        finally:  # after an interrupt as well: what was computed is kept
            save_dataset(results, out / "results.nc")
    if further is not None:
        save_dataset(further, out / "beyond.nc")
    simulated_s = sum(preview.duration_s for preview in previews)
    return _Campaign(recording, results, further, rig, effects, simulated_s, rebuild)


_PARTS = 2  # that do not wait for the campaign: with effects off, and above the paper's range


def _results(plan: "Plan", rig: "RigSpec", seed: int) -> "xr.Dataset":
    """Return the results of a plan on the twin."""
    from sinew.analysis.analysed import analyse_with
    from sinew.twin.simulate import simulate

    return analyse_with(simulate(plan, rig, seed=seed), rig)


def report(
    context: typer.Context,
    source: Annotated[
        Path,
        typer.Argument(metavar="DIR|RECORDING|RIG", help="A recording, or the folder of a recording.nc; or a rig."),
    ],
    rig: Annotated[str | None, option("RIG", "Recording: a rig; else the one that it names.")] = None,
    answers: Annotated[bool, flag("--answers", "Recording: also answer the paper's open questions.")] = False,
    film: Annotated[str | None, option("sweep|ring-down", "Recording: also film it.")] = None,
    pretension: Annotated[float, option("MM", "The film's pretension, or the closest one.", "--pretension-mm")] = 0.0,
    azimuth: Annotated[
        float | None, option("DEG", "Rig: where it bends to, from y towards z; else 90.", "--azimuth-deg")
    ] = None,
    out: Annotated[
        Path | None, option("DIR", "Folder; else that of recording.nc, or one of the recording's name; of a rig none.")
    ] = None,
    json: Json = False,
) -> None:
    """Write the report of a recording: figures, summary and page.

    Results beside the recording are used unless they belong to another recording or rig. A recording that names no
    rig needs none: then nothing is said of stiffness and damping constants, and sensors are taken as perfect. A
    recording of a resonance that was tracked gives its table and figure, on a page.

    --answers adds the paper's open questions: verdicts, numbers with 90 % intervals, and what cannot be told, in
    answers.html, answers.json and figures; of a whole campaign in about half a minute. --film writes the joint as it
    swings (the paper's Video S1): figures/sweep.webp or figures/ring-down.webp.

    Of a RIG the questions are answered that no recording answers, in a minute or two: whether a bend moves the
    resonance, what moves with the torsion, how unequal tensions get, the spinal engine, what the joint carries, and
    how a bench would test each.
    """
    rebuild = console.command_line(context)
    if _is_rig(source):
        for name, written in console.given_options(context).items():
            if name in ("rig", "film", "pretension"):
                raise SpecError(f"{written} is for a recording, and {source} is a rig; leave it out")
        _answer_rig(source, out, azimuth, rebuild, json=json)
        return
    if azimuth is not None:
        raise SpecError("found --azimuth-deg beside a recording, which holds its pose; give it with a rig")
    if film is not None:
        console.check_choice("--film", film, _FILMS)
    filmed = None if film is None else (film, pretension)
    _report_recording(source, rig, out, rebuild, answers=answers, filmed=filmed, json=json)


_FILMS = ("sweep", "ring-down")


def _report_recording(
    source: Path,
    rig: str | None,
    out: Path | None,
    rebuild: str,
    *,
    answers: bool,
    filmed: tuple[str, float] | None,
    json: bool,
) -> None:
    """Write figures, summary and page of a recording, and its answers and a film (kind, pretension [mm]) on request."""
    from sinew.analysis.analysed import recording_rig
    from sinew.measure.files.netcdf import load_recording, save_dataset

    file = source / "recording.nc" if source.is_dir() else source
    if not file.is_file():
        raise FileError(f"found no recording {file}; expected a file of sinew simulate, run or import, or its folder")
    began = time.monotonic()
    recording = load_recording(file)
    rig_ = recording_rig(recording, rig)
    home = file.parent if file.name == "recording.nc" else file.with_suffix("")
    folder = home if out is None else out
    if folder != home:
        console.require_own(folder, "results.nc", lambda results: stored.is_of(results, recording))
    console.require_folder(folder)
    if set(map(str, recording["kind"].values)) <= {"tracking", "idle"}:
        if answers or filmed is not None:
            raise SpecError(f"{file} holds a tracked resonance alone; leave --answers and --film out")
        _report_tracking(recording, rig, folder, rebuild, json=json)
        return
    earlier = stored.stored_results(home / "results.nc", recording, rig_)
    before = {} if earlier is None else stored.stored_times(home / "summary.json")
    results = _analyse(recording, rig_) if earlier is None else earlier
    if earlier is None or folder != home:
        save_dataset(results, folder / "results.nc")
    steps = recording["time_s"].diff("sample")
    if made := str(recording.attrs.get("command", "")):
        plain = rebuild == shlex.join(["sinew", "report", str(source)])
        rebuild = made if plain and made.startswith("sinew reproduce ") else f"{made} && {rebuild}"
    campaign = _Campaign(
        recording,
        results,
        stored.stored_beyond(home / "beyond.nc", rig_),
        rig_,
        stored.stored_effects(home / "effects.json", results),
        before.get("simulated_s", float(steps.median()) * recording.sizes["sample"]),
        rebuild,
    )
    found = _answer_recording(campaign, folder) if answers else []
    document = _write_pages(campaign, folder, began=began, wall_s=before.get("wall_s"))
    if answers:  # after the report, which it names
        _write_answers(found, campaign, folder)
    if filmed is not None:
        document["film"] = _film(recording, *filmed, folder)
    if json:
        console.print_json(document | ({"answers": [one.to_json() for one in found]} if answers else {}))
        return
    _show(document, results, folder)
    if answers:
        _print_answers(found)
        print(f"answers: {folder / 'answers.html'}")
    if filmed is not None:
        print("film: {film}, {frames} frames, {lasts_s:.1f} s".format(**document["film"]))


def _film(recording: "xr.Dataset", kind: str, pretension_mm: float, folder: Path) -> dict[str, float | str]:
    """Return what was filmed, into the folder of the figures."""
    from sinew.figures.motion import save_film

    path, frames_per_s = folder / "figures" / f"{kind}.webp", 20
    with console.progress_bar("film") as progress:
        count = save_film(
            recording, path, cast("FilmKind", kind), pretension_mm, frames_per_s=frames_per_s, progress=progress
        )
    return {"film": str(path), "kind": kind, "frames": count, "lasts_s": count / frames_per_s}


def _report_tracking(recording: "xr.Dataset", rig: str | None, folder: Path, rebuild: str, *, json: bool) -> None:
    """Write table, figure and page of a recording of nothing but tracked motions."""
    from sinew.analysis.analysed import analyse
    from sinew.analysis.results import RecordingResult
    from sinew.figures.tuned import save_tracking, write_tracking_page

    found = analyse(recording, rig)
    assert isinstance(found, RecordingResult)
    assert found.tracking is not None
    figures = save_tracking(found.tracking.to_dict(), folder / "figures")
    page = write_tracking_page(folder / "report.html", found.tracking, figures, rebuild)
    console.print_result(found.to_dict(), found.blocks(), f"report: {page}", json=json)


def _effects(plan: "Plan", rig: "RigSpec") -> list[dict[str, Any]]:
    """Return the share of each effect; empty for a plan of other pretensions."""
    from sinew.paper.campaign import SHARE_PRETENSIONS_MM, effect_shares

    return effect_shares(rig) if set(SHARE_PRETENSIONS_MM) <= set(plan.pretension.pretension_mm) else []


def _analyse(recording: "xr.Dataset", rig: "RigSpec | None") -> "xr.Dataset":
    """Return the results of a recording."""
    from sinew.analysis.analysed import analyse_with

    with console.progress_bar("analyse"):
        return analyse_with(recording, rig)


def _write_pages(campaign: _Campaign, folder: Path, *, began: float, wall_s: float | None = None) -> dict[str, Any]:
    from sinew.paper.campaign import summarise
    from sinew.paper.report import draw_figures, write_report

    with console.progress_bar("draw"):
        figures = draw_figures(campaign.recording, campaign.results, folder / "figures")
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
            rig=campaign.rig,
            posterior=_posterior(campaign.rig),
            effects=campaign.effects,
            answers=stored.stored_answers(folder / "answers.json", campaign.recording),
            rebuild=campaign.rebuild,
        )
    return summary


def _posterior(rig: "RigSpec | None") -> dict[str, dict[str, Any]] | None:
    """Return what the paper's numbers leave of a shipped rig; None for any other rig, even one of the same name."""
    from sinew.plan.toml import list_shipped, load_rig, read_posterior

    if rig is None or rig.name not in list_shipped("rigs") or load_rig(rig.name) != rig:
        return None
    return read_posterior(rig.name)


def _show(summary: dict[str, Any], results: "xr.Dataset", folder: Path) -> None:
    from sinew.figures.page import MEANINGS, measured_tables, window_table
    from sinew.paper.campaign import count_roles

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
    meanings = [one for one in measured_tables(results) if one.title == MEANINGS]
    for table in filter(None, (*meanings, window_table(results, ends=True))):
        console.print_table(table.head, table.rows, table.title)
        print(textwrap.fill(table.note, 120))
    print(f"{summary['simulated_s']:.0f} s of motion, {summary['wall_s']:.0f} s of work")
    print(f"report: {folder / 'report.html'}")


def _number(value: Any) -> str:
    return number(value) if isinstance(value, int | float) and not isinstance(value, bool) else str(value or "")


# The paper's open questions are asked of a recording, or of a rig.


def _answer_recording(campaign: _Campaign, folder: Path) -> "list[Answer]":
    """Return the answers of a recording, also written to a folder as answers.json, which its report takes up."""
    from sinew.measure.files.netcdf import content_hash
    from sinew.paper.questions import answer_questions
    from sinew.solve.programs import use_all_cores

    use_all_cores()
    recording, rig = campaign.recording, campaign.rig
    with console.progress_bar("answer") as progress:
        answers = answer_questions(
            recording,
            campaign.results,
            rig,
            beyond=campaign.beyond,
            progress=lambda _step, done, total: progress(done, total),
        )
    document = {
        "recording_hash": str(recording.attrs.get("content_hash") or content_hash(recording)),
        "rig": "" if rig is None else rig.name,
        "answers": [one.to_json() for one in answers],
    }
    console.write_json(document, folder / "answers.json")
    return answers


def _write_answers(answers: "list[Answer]", campaign: _Campaign, folder: Path) -> None:
    from sinew.paper.questions import draw_answers
    from sinew.paper.report import write_answers

    figures = draw_answers(answers, folder / "figures")
    write_answers(folder, answers, campaign.recording, figures=figures, rebuild=campaign.rebuild)


def _is_rig(file: Path) -> bool:
    from sinew.plan.toml import list_shipped

    return file.suffix == ".toml" or (not file.exists() and str(file) in list_shipped("rigs"))


def _answer_rig(file: Path, out: Path | None, azimuth: float | None, rebuild: str, *, json: bool) -> None:
    """Print what a rig answers; write page, document and figures where `out` says so."""
    if azimuth is not None:
        console.checked_number("--azimuth-deg", azimuth, "an angle from -360 to 360°", low=-360, high=360)
    if out is not None:
        console.require_folder(out)
    from sinew.paper.questions import AZIMUTH_DEG, answer_rig, draw_answers
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
        from sinew.paper.report import write_answers

        figures = draw_answers(answers, out / "figures")
        console.write_json(document, out / "answers.json")
        write_answers(out, answers, rig_, figures=figures, rebuild=rebuild)
    if json:
        console.print_json(document)
        return
    _print_answers(answers)
    if out is not None:
        print(f"page: {out / 'answers.html'}")


def _print_answers(answers: "list[Answer]") -> None:
    """Print questions and verdicts, then the two sentences of each."""
    console.print_table(("question", "answer"), [(one.question, one.verdict) for one in answers])
    for one in answers:
        for sentence in one.sentences:
            print(textwrap.fill(sentence, 100, initial_indent="- ", subsequent_indent="  "))
