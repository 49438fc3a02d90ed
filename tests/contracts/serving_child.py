"""`sinew serve` with runs and a page that are cheap: `python -m tests.contracts.serving_child OPTION ...`."""

import functools
import sys

from tests.contracts.serving import PAGE, fake_command

from sinew.apps.cli import main
from sinew.apps.dashboard import steward

if __name__ == "__main__":
    page = (sys.executable, "-S", "-c", PAGE)
    settings = functools.partial(steward.Settings, command=fake_command, page=page)
    steward.Settings = settings  # type: ignore[assignment,misc]
    sys.exit(main(["serve", *sys.argv[1:]]))
