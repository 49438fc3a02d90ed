"""The distribution's name, and how what its extras need is installed.

Import and command are `sinew`; the distribution is not, for another project has that name on the public index: what
`pip install sinew[...]` fetches is not this. So nothing here is looked up by name: an extra is installed from the clone
or the wheel that is at hand.
"""

from sinew import __version__

DISTRIBUTION = "sinew-lab"


def how_to_install(extra: str) -> str:
    """Return the words, after "install it: ", that say how the packages of an extra such as `dashboard` come in."""
    wheel = f"{DISTRIBUTION.replace('-', '_')}-{__version__}-py3-none-any.whl"
    return (
        f'in a clone `.venv/bin/python -m pip install -e ".[{extra}]"`, with a wheel `pip install "{wheel}[{extra}]"`'
    )
