"""Tickets, their numbers, and the one operator."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.apps.dashboard.operators import LAPSES_S, LEAVES_S, Operators, RefusedError, Ticket


@given(st.lists(st.integers(-5, 30)))
def test_a_number_is_heard_if_it_is_greater_than_all_before(numbers: list[int]) -> None:
    operators, heard = Operators(), [0]
    ticket = operators.give_ticket()
    for number in numbers:
        try:
            operators.admit(ticket.id, number)
        except RefusedError:
            assert number <= max(heard)
        else:
            assert number > max(heard)
            heard.append(number)


def test_numbers_of_one_page_do_not_count_for_another() -> None:
    operators = Operators()
    first, second = operators.give_ticket(), operators.give_ticket()
    operators.admit(first.id, 9)
    assert operators.admit(second.id, 1) is second


def test_an_unknown_ticket_tells_the_page_to_take_another() -> None:
    with pytest.raises(RefusedError) as refused:
        Operators().admit("made up", 1)
    assert (refused.value.status, refused.value.more) == (403, {"ticket": False})


def test_a_flood_of_tickets_neither_grows_nor_puts_the_operator_out() -> None:
    time = iter(range(10**6))
    operators = Operators(clock=lambda: next(time))
    operator = operators.give_ticket()
    operators.take(operator)
    others = [operators.give_ticket() for _ in range(3000)]
    assert operators.admit(operator.id, 1) is operator
    with pytest.raises(RefusedError):
        operators.admit(others[0].id, 1)


def test_pages_that_were_not_heard_of_lately_are_no_viewers() -> None:
    time = [0.0]
    operators = Operators(clock=lambda: time[0])
    _, second = operators.give_ticket(), operators.give_ticket()
    time[0] = 25.0
    operators.see(second.id)
    time[0] = 50.0
    assert operators.viewers() == 1


def test_who_gives_the_bench_up_operates_no_more() -> None:
    operators = Operators()
    ticket = operators.give_ticket()
    operators.take(ticket)
    operators.give(ticket)
    assert operators.operator(ticket.id) is None


def test_a_ticket_with_odd_characters_operates_nothing() -> None:
    operators = Operators()
    operators.take(operators.give_ticket())
    told = operators.operator("ä\u2028")
    assert told is not None
    assert told["mine"] is False


def left() -> tuple[Operators, Ticket, list[float]]:
    """Return who operated from a page that is closed, half of the grace ago, and the clock."""
    time = [0.0]
    operators = Operators(clock=lambda: time[0])
    ticket = operators.give_ticket()
    operators.take(ticket)
    operators.leave(ticket.id)
    time[0] = LEAVES_S / 2
    return operators, ticket, time


def test_control_ends_soon_after_its_page_was_closed() -> None:
    operators, ticket, time = left()
    assert operators.operator(ticket.id) is not None
    time[0] = LEAVES_S + 0.1
    assert operators.operator(ticket.id) is None
    with pytest.raises(RefusedError, match="nobody is in control"):
        operators.require_operator(ticket)


def test_control_stays_with_a_tab_that_goes_from_page_to_page() -> None:
    operators, ticket, time = left()
    operators.see(ticket.id)
    time[0] = 2 * LEAVES_S
    assert operators.operator(ticket.id) is not None


def test_control_ends_where_its_page_is_not_heard_of_and_stays_where_it_is() -> None:
    time = [0.0]
    operators = Operators(clock=lambda: time[0])
    ticket = operators.give_ticket()
    operators.take(ticket)
    for _ in range(3):
        time[0] += LAPSES_S - 1
        operators.see(ticket.id)
    assert operators.operator(ticket.id) is not None
    time[0] += LAPSES_S + 1
    assert operators.operator(None) is None


def test_a_tab_that_lost_control_while_it_was_silent_does_not_get_it_back_by_speaking() -> None:
    time = [0.0]
    operators = Operators(clock=lambda: time[0])
    ticket = operators.give_ticket()
    operators.take(ticket)
    time[0] = LAPSES_S + 1
    assert operators.admit(ticket.id, 1) is ticket
    with pytest.raises(RefusedError):
        operators.require_operator(ticket)
