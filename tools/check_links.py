"""The links of the Markdown pages, followed as far as they stay inside the repository.

`python tools/check_links.py` prints every link to a file or heading that does not exist and exits 1 if there is any.
Addresses on the network are left alone.
"""

import re
import sys
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tools.tree import ROOT, repository_files

_FENCE = re.compile(r"^(```+|~~~+).*?^\1\s*$", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`\n]*`")
_LINK = re.compile(r"!?\[[^\]]*\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
_HEADING = re.compile(r"^#{1,6}\s+(.*?)\s*#*$", re.MULTILINE)


def anchors(text: str) -> set[str]:
    """Return the anchors that the headings of a Markdown text get: lower case, words joined by hyphens."""
    found: set[str] = set()
    for heading in _HEADING.findall(_FENCE.sub("", text)):
        words = re.sub(r"[^\w\s-]", "", heading.replace("`", "").lower()).strip()
        found.add(re.sub(r"\s", "-", words))
    return found


def broken_links(page: Path) -> list[str]:
    """Return one sentence for every link of a page that leads nowhere inside the repository."""
    prose = _CODE.sub("", _FENCE.sub("", page.read_text(encoding="utf-8")))
    broken: list[str] = []
    for target in _LINK.findall(prose):
        if re.match(r"[a-z][a-z0-9+.-]*:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        if not path.exists():
            broken.append(f"links to {target}, which does not exist")
        elif anchor and path.suffix == ".md" and anchor not in anchors(path.read_text(encoding="utf-8")):
            broken.append(f"links to {target}, but {path.name} has no such heading")
    return broken


def main() -> int:
    """Print the broken links of all Markdown pages; return the exit status."""
    pages = repository_files("*.md")
    broken = [f"{page.relative_to(ROOT)} {sentence}" for page in pages for sentence in broken_links(page)]
    print("\n".join(broken) if broken else f"all links inside {len(pages)} Markdown pages lead somewhere")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
