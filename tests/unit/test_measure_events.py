"""Events of a run: what a journal holds of them, how they come back, and what is said of them."""

import math
from dataclasses import replace

import pytest

from sinew.measure import events

STATE = events.Track(
    3.25, True, False, 3.3517, phase_error_deg=-0.42, command_deg=20.0, torsion_deg=41.3, pretension_mm=4.0
)
HEALTH = events.Health("running", 7, 1, 0, 0.1, 2.0, {"drive": 31.0}, None, {"retries": 2}, 1.0, 9.0, None, 2)
EVENTS = (
    events.Pulled.of(),
    events.Contact.of(current_ma=43.2),
    events.Pretensioned(2.0, 2.01, 0.2, 0.21, 0.08, (0.01, -0.02), 1.5),
    events.Hole.of(why="the computer {paused}", times=1, most=3),
    events.Ended.of(why="stopped", left="release"),
    STATE,
    HEALTH,
)


@pytest.mark.parametrize("event", EVENTS, ids=[event.kind for event in EVENTS])
def test_an_event_comes_back_from_the_text_of_the_journal(event: events.Event) -> None:
    assert events.read_event(event.kind, event.written()) == event


def test_a_sentence_stands_in_the_journal_as_people_read_it() -> None:
    assert events.Contact.of(current_ma=43.2).written() == "first contact at 43 mA"


def test_the_row_of_an_older_journal_is_read_with_what_was_not_known_then() -> None:
    text = '{"asked_mm": 2.0, "reached_mm": NaN, "asked_current_a": 0.2, "current_a": 0.21, "tilt_deg": 0.123, '
    found = events.read_event("pretension", text + '"offsets": [0.01, -0.02], "levelling_s": 1.5, "gone": 1}')
    assert isinstance(found, events.Pretensioned)
    assert math.isnan(found.reached_mm)
    assert found.offsets == (0.01, -0.02)
    assert str(found) == "pretension 2 mm is set, tilt 0.12°"


@pytest.mark.parametrize(("kind", "text"), [("weather", "it rains"), ("health", '{"cycles": 7}'), ("track", "lost")])
def test_what_another_version_wrote_is_a_note(kind: str, text: str) -> None:
    assert events.read_event(kind, text) == events.Note(text)


def test_the_line_of_a_tracking_state_says_what_is_known_and_what_is_not() -> None:
    assert str(STATE) == "   3.2 s  locked     3.352 Hz  error  -0.4°  torsion  41.3°  command 20.0°   4.00 mm"
    blind = str(replace(STATE, is_locked=False, is_coasting=True, phase_error_deg=None, wanted_hz=3.5))
    assert "coasting" in blind
    assert "error -°" in blind
    assert blind.endswith("wanted 3.500 Hz")
