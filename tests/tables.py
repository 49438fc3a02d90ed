"""Tables of cases, written as text."""


def rows(table: str) -> list[tuple[str, ...]]:
    """Return the cells of every line of a table; `=>` stands between two cells, spaces around them do not count."""
    return [tuple(cell.strip() for cell in line.split("=>")) for line in table.strip().splitlines()]
