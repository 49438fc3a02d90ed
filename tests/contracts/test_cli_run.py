"""`sinew run`: what a whole run in virtual time says and leaves, from first contact to the recording."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import joint, virtual_port
from tests.contracts.virtual_run import spoken

from sinew.measure.files.netcdf import load_recording
from sinew.plan.toml import load_rig


class Whole(NamedTuple):
    folder: Path
    status: int
    document: dict[str, Any]
    err: str


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Whole]:
    """A run of the tiny plan on the joint, from first contact to the recording."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "tiny.toml").write_text(TINY)
    with pytest.MonkeyPatch.context() as monkeypatch:
        spec = load_rig("paper")
        port = virtual_port(monkeypatch, spec, joint(spec))
        status, out, err = spoken("run", str(folder / "tiny.toml"), "--port", "b", "--out", str(folder), "--json")
        assert port.rig.in_safe_state()
        yield Whole(folder, status, json.loads(out), err)


KEYS = """plan rig complete ended safe_state is_safe left frozen_ms pauses groups groups_done ended_by_pause pretensions
cycles wire journal recording bus doubts"""


def test_a_whole_run_ends_with_status_0_and_a_document_with_the_keys_of_the_reference(whole: Whole) -> None:
    assert (whole.status, whole.document["complete"], whole.document["is_safe"]) == (0, True, True)
    assert whole.document["ended"] == "all 2 groups are recorded"
    assert whole.document["wire"] == {"cycle_ms": 2.68, "period_ms": 5.0}
    assert sorted(KEYS.split()) == sorted(whole.document)


def test_stderr_tells_the_run_step_by_step(whole: Whole) -> None:
    pulled, contact, pretension = whole.err.splitlines()
    assert pulled == "sinew: the tendons are pulled to first contact"
    assert contact.startswith("sinew: first contact at ")
    assert pretension.startswith("sinew: pretension 2 mm is set, tilt 0.0")


def test_the_pretension_of_a_whole_run_came_out_as_asked(whole: Whole) -> None:
    (pretension,) = whole.document["pretensions"]
    assert pretension["asked_mm"] == 2
    assert abs(pretension["reached_mm"] - 2) < 0.1
    assert pretension["tilt_deg"] < 0.2


def test_a_whole_run_leaves_journal_recording_and_what_it_found(whole: Whole) -> None:
    left = {path.name for path in whole.folder.iterdir() if not path.name.startswith("journal.sqlite-")}
    assert left == {"tiny.toml", "recording.nc", "results.nc", "analysis.json", "journal.sqlite", "journal.sqlite.lock"}


def test_the_recording_of_a_whole_run_says_by_which_command_it_came(whole: Whole) -> None:
    attrs = load_recording(whole.folder / "recording.nc").attrs
    assert attrs["source"] == "emulator"
    assert attrs["command"] == f"sinew run {whole.folder}/tiny.toml --rig paper --port b --out {whole.folder}"


def test_analyse_reads_the_recording_of_a_whole_run_like_any_other(whole: Whole) -> None:
    status, out, _ = spoken("analyse", str(whole.folder / "recording.nc"), "--json")
    (row,) = json.loads(out)["response"]
    assert (status, row["pretension_mm"], row["frequency_hz"], row["repeats"]) == (0, 2, 3, 1)
