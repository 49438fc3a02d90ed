"""Streams of random, damaged and spliced packets: what comes out of the decoder, in numbers."""

import pytest
from tests.properties.hardware_streams import Tally, run_streams


@pytest.fixture(
    scope="module",
    params=[
        pytest.param((20_000, 1), id="20 thousand streams"),
        pytest.param((1_000_000, 2), id="a million streams", marks=[pytest.mark.slow, pytest.mark.long]),
    ],
)
def tally(request: pytest.FixtureRequest) -> Tally:
    """Return the counts of a run; that it comes back at all says that no stream made the decoder raise."""
    done = run_streams(*request.param)
    print(done)
    return done


def test_no_packet_comes_out_that_does_not_stand_whole_in_the_stream(tally: Tally) -> None:
    assert tally.invented == 0


def test_every_packet_that_arrived_whole_comes_out_also_right_behind_garbage(tally: Tally) -> None:
    assert tally.lost == 0


def test_damage_passes_the_crc_no_more_often_than_16_bits_allow(tally: Tally) -> None:
    # Each wrong packet of full length passes with 2^-16; five standard deviations of that Poisson number on top.
    expected = (tally.crc_errors + tally.undetected) / 2**16
    assert tally.undetected <= expected + 5 * expected**0.5


def test_bytes_that_could_belong_to_two_packets_are_rare(tally: Tally) -> None:
    # A packet must end in FF, lose just that, and be followed by another.
    assert tally.shared <= tally.damaged / 1000


def test_the_streams_were_worth_running(tally: Tally) -> None:
    assert tally.damaged > 0.2 * tally.sent
    assert tally.accepted > 0.5 * tally.sent
    assert tally.crc_errors > 0.05 * tally.damaged
