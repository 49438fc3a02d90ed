"""This is where `sinew identify` speaks on a terminal."""

from collections.abc import Mapping
from typing import Any

from sinew.apps.console import print_table
from sinew.apps.identify_found import Found
from sinew.measure.estimate import number, shown, span

__all__ = ["print_found"]

_TITLES = {
    "profile": "by profile likelihood",
    "posterior": "posterior",
    "bootstrap": "by bootstrap over repeats",
}


def print_found(found: Found) -> None:
    """Print the numbers, the models that were compared, and the sentences, the verdict first."""
    document = found.document
    both = {name: document[name] for name in ("natural_frequency_hz", "damping_ratio")}
    _print_quantities(f"model {document['model']}", both | document["parameters"])
    for key, title in _TITLES.items():
        if document.get(key):
            _print_quantities(title, document[key])
    unit = "" if document["unit"] == "1" else f"/({document['unit']})"
    if document["compared"]:
        compared = [(row["model"], number(row["rmse_test"]), number(row["bic"])) for row in document["compared"]]
        print_table(("compared", f"held-out rmse{unit}", "BIC"), compared)
    verdict, *rest = found.sentences
    print(f"{verdict[:1].upper()}{verdict[1:]}.")
    train, test = document["rmse"]["train"], document["rmse"]["test"]
    held = "" if test is None else f", {number(test)} where it was held out"
    print(f"- residuals{unit}: {number(train)} rms where it was fitted{held}")
    for sentence in (*rest, *document["unidentifiable"]):
        print(f"- {sentence}")


def _print_quantities(title: str, quantities: Mapping[str, Mapping[str, Any]]) -> None:
    cells = [(name, shown(one), span(*(one["interval90"] or (None, None)))) for name, one in quantities.items()]
    print_table((title, "value ± std", "90 % interval"), cells)
