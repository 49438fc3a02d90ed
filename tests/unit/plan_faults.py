"""A fault put into the text of a rig or a plan, and what is said of it."""

from collections.abc import Callable

import pytest

from sinew.measure.errors import SpecError


def refusal(parse: Callable[[str], object], text: str, old: str, new: str) -> str:
    """Return the line with which a text is refused in which something stands in another's place."""
    assert old in text
    with pytest.raises(SpecError) as caught:
        parse(text.replace(old, new, 1))
    assert "\n" not in str(caught.value)
    return str(caught.value)
