"""This is where `sinew identify` turns the recording of an oscillation into its mechanics."""

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sinew.apps.console import print_json, print_table, progress_bar
from sinew.apps.identify_input import recording_records, table_record
from sinew.apps.options import ColumnTime, Json
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.identify.comparison import Comparison
    from sinew.identify.fitted import Fit
    from sinew.identify.record import Excitation, Record

__all__ = ["identify"]

_JOINT = ("linear", "cubic", "coulomb-cubic", "loss-factor-cubic")
_EXCITATIONS = ("force", "torque", "base", "lever", "none")


def identify(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A CSV file, or a recording of Sinew (NetCDF).")],
    time: ColumnTime = None,
    input_: Annotated[
        str | None, typer.Option("--input", metavar="COL[:unit]", help="Column of what drives it.")
    ] = None,
    output: Annotated[
        str | None, typer.Option("--output", metavar="COL[:unit]", help="Column of how it moves.")
    ] = None,
    excitation: Annotated[
        str | None,
        typer.Option("--excitation", metavar="|".join(_EXCITATIONS), help="What the input is; none is a free decay."),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            "--model", metavar="linear|loss-factor|coulomb|cubic|cubic-quadratic|tendon|auto", help="What to fit."
        ),
    ] = "auto",
    train: Annotated[
        str | None, typer.Option("--train", metavar="A:B", help="Samples to fit: indices from 0, half open.")
    ] = None,
    test: Annotated[
        str | None, typer.Option("--test", metavar="A:B", help="Samples to predict, held out of the fit.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option("--rate", metavar="HZ", help="Samples per second, where there is no time column.")
    ] = None,
    pretension: Annotated[
        float | None, typer.Option("--pretension", metavar="MM", help="Of a rig's recording; else its smallest.")
    ] = None,
    json: Json = False,
) -> None:
    """Identify stiffness, damping law and nonlinearity, with intervals, and say which model the data support.

    Without --train and --test the fit is to all samples, and every fourth block of them is held out once to compare
    models. With --model auto the stiffness law and the damping law are chosen, or it says what cannot be told.
    """
    if excitation is not None and excitation not in _EXCITATIONS:
        raise SpecError(f"--excitation is {excitation!r}, expected one of {', '.join(_EXCITATIONS)}")
    chosen = cast("Excitation | None", excitation)
    if file.suffix == ".nc":
        if any(value is not None for value in (time, input_, output, rate)):
            raise SpecError("a recording knows its columns; --time, --input, --output and --rate are for tables")
        from sinew.measure.netcdf import load_recording

        records = recording_records(load_recording(file), chosen, pretension)
    else:
        if chosen is None and input_ is not None:
            raise SpecError(f"say what the input is: --excitation {'|'.join(_EXCITATIONS[:-1])}")
        records = [table_record(file, time, input_, output, chosen or "none", rate)]
    document = _identify(records, model, _range("--train", train), _range("--test", test))
    if json:
        print_json(document)
    else:
        _print(document)


def _range(option: str, text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d+):(\d+)", text.strip())
    if found is None:
        raise SpecError(f"{option} is {text!r}, expected A:B, two sample indices (from 0, B not included)")
    return int(found[1]), int(found[2])


def _identify(
    records: "list[Record]", model: str, train: tuple[int, int] | None, test: tuple[int, int] | None
) -> dict[str, Any]:
    from sinew.identify.comparison import compare, compare_laws
    from sinew.identify.diagnosis import refuse_hopeless
    from sinew.identify.held_out import split_record
    from sinew.identify.model import get_model
    from sinew.twin.cache import configure

    configure()
    for record in records:
        refuse_hopeless(record)
    if len(records) > 1:
        return _joint(records, model, train or test)
    wanted = None if model == "auto" else get_model(model)
    split = split_record(records[0], train, test)
    refuse_hopeless(split.record)
    if wanted is not None:
        return _document(compare(split, [wanted]))
    with progress_bar("models compared") as progress:
        return _document(compare_laws(split, progress))


def _document(compared: "Comparison") -> dict[str, Any]:
    from sinew.identify.diagnosis import suspicions

    best, row = compared.best, compared.rows[0]
    told = [compared.verdict, best.message, *suspicions(best)]
    rows = [
        {"model": one.model.name, "rmse_test": _number(one.rmse_test), "bic": _number(one.bic)} for one in compared.rows
    ]
    return _fit_part(best, row.rmse_test, told) | {"compared": rows}


def _joint(records: "list[Record]", model: str, ranges: object) -> dict[str, Any]:
    """Return the document of several segments of a rig with the same mechanics; every third is held out once."""
    from sinew.identify.fit import fit
    from sinew.identify.held_out import predict

    if ranges is not None:
        raise SpecError("--train and --test are for one record; this recording has several segments")
    test = records[1::3]
    rows: list[dict[str, Any]] = []
    for name in _JOINT if model == "auto" else (model,):
        taught = fit([record for i, record in enumerate(records) if i % 3 != 1], name)
        squares = sum(float(((record.output - predict(taught, record)) ** 2).sum()) for record in test)
        rmse = math.sqrt(squares / sum(record.size for record in test))
        rows.append({"model": name, "rmse_test": _number(rmse), "bic": _number(taught.bic())})
    rows.sort(key=lambda row: row["rmse_test"] if row["rmse_test"] is not None else math.inf)
    best = fit(records, str(rows[0]["model"]))
    told = [
        f"{len(records)} segments at {records[0].group} were fitted together",
        "the model with the smallest error of the held-out segments is reported",
        best.message,
    ]
    return _fit_part(best, rows[0]["rmse_test"], told) | {"compared": rows}


def _fit_part(best: "Fit", rmse_test: float | None, told: list[str]) -> dict[str, Any]:
    return {
        "model": best.model.name,
        "parameters": {name: one.to_json() for name, one in best.parameters.items()},
        "natural_frequency_hz": best.natural_frequency_hz.to_json(),
        "damping_ratio": best.damping_ratio.to_json(),
        "rmse": {"train": _number(best.rmse), "test": None if rmse_test is None else _number(rmse_test)},
        "unit": best.unit,
        "converged": best.converged,
        "message": "; ".join(told),
        "unidentifiable": list(best.unidentifiable),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _print(document: dict[str, Any]) -> None:
    rows = {"natural_frequency_hz": document["natural_frequency_hz"], "damping_ratio": document["damping_ratio"]}
    cells = [
        (name, *(_cell(value) for value in (one["value"], one["std"], *one["interval90"])))
        for name, one in (rows | document["parameters"]).items()
    ]
    print_table((f"model {document['model']}", "value", "std", "90 % from", "to"), cells)
    compared = [(row["model"], _cell(row["rmse_test"]), _cell(row["bic"])) for row in document["compared"]]
    print_table(("compared", f"held-out rmse/{document['unit']}", "BIC"), compared)
    for sentence in (*document["message"].split("; "), *document["unidentifiable"]):
        print(f"- {sentence}")


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.5g}"
