"""A run on the emulated bench, analysed, calibrated, predicted and answered, against the rig that the bench plays."""

import json
from pathlib import Path

import pytest
from tests.contracts.emulated_bench import joint, virtual_port
from tests.contracts.virtual_run import interrupt, spoken

from sinew.plan.toml import load_rig

pytestmark = [pytest.mark.slow, pytest.mark.long]

PLAN = """
name = "chain"
[pretension]
pretension_mm = [2, 8]
mode = "MODE"
rest_s = 0.5
[sweep]
frequency_hz = [2.5, 3.2, 4.0]
repeats = 1
settle_s = 1.5
periods = 4
[ring_down]
frequency_hz = [3.0, 4.0]
repeats = 1
drive_s = 1.5
record_s = 1.5
"""


@pytest.mark.parametrize(
    ("mode", "killed_s"),
    [("position", None), ("position-with-current-limit", None), ("current", None), ("position", 23.0)],
)
def test_a_run_of_the_bench_is_calibrated_to_the_rig_that_it_plays(
    mode: str, killed_s: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of nine 90 % intervals fewer than six hold the truth once in a hundred times, were they independent."""
    rig, plan, out = load_rig("paper"), tmp_path / "chain.toml", tmp_path / "run"
    plan.write_text(PLAN.replace("MODE", mode))
    port = virtual_port(monkeypatch, rig, joint(rig))
    command: tuple[str, ...] = ("run", str(plan), "--port", "b", "--out", str(out))
    if killed_s is not None:
        interrupt(port, killed_s)
        assert spoken(*command)[0] == 1
        port.wait_until(port.now() + 10.0)  # until the joint is at rest
        command = (*command, "--resume")
    assert spoken(*command)[0] == 0
    recording, found = str(out / "recording.nc"), str(tmp_path / "found.toml")
    assert spoken("analyse", recording)[0] == 0
    status, text, _ = spoken("calibrate", "paper", recording, "--out", found, "--json")
    assert status == 0
    document, truth = json.loads(text), dict(rig.parameters())
    rows = {name: row["after"] for name, row in document["parameters"].items() if row["after"]["std"] is not None}
    inside = [name for name, row in rows.items() if row["interval90"][0] <= truth[name].value <= row["interval90"][1]]
    assert document["converged"]
    assert len(rows) == 9
    assert len(inside) >= 6, rows
    assert spoken("predict", found, "--against", recording)[0] == 0
    status, text, _ = spoken("answer", recording, "--out", str(tmp_path / "answers"))
    assert (status, "No tendon joint could be fitted" in " ".join(text.split())) == (0, False)
