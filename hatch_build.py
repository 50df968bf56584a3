"""The package's addresses, and its long description: README, with links and pictures that work from anywhere.

Within the project README's links are relative. A page that shows the description alone has nothing beside it, so every
link becomes one into the project's repository, at this version's tag. Its address is `source` in pyproject.toml;
while that is empty, a build names no address, and links are plain text.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?!https?:|mailto:|#)(?P<target>[^)\s]+)\)")


def absolute(text: str, source: str, version: str) -> str:
    """`text` with each relative link as one into `source`, as hosts of repositories lay them out."""

    def link(found: re.Match[str]) -> str:
        if not source:
            return "" if found["picture"] else found["text"]
        kind = "raw" if found["picture"] else "blob"
        return f"{found['picture']}[{found['text']}]({source}/{kind}/v{version}/{found['target']})"

    return _LINK.sub(link, text)


def version_of(root: Path) -> str:
    """As `arva_hil/__init__.py` has it."""
    text = (root / "arva_hil" / "__init__.py").read_text(encoding="utf-8")
    found = re.search(r'(?m)^__version__ = "([^"]+)"$', text)
    if not found:
        raise ValueError('arva_hil/__init__.py: no line __version__ = "…"')
    return found[1]


class LongDescription(MetadataHookInterface):
    """Called by hatchling: the keys `readme` and `urls` are dynamic."""

    def update(self, metadata: dict[str, Any]) -> None:
        root = Path(self.root)
        text = (root / "README.md").read_text(encoding="utf-8")
        source = self.config["source"]
        text = absolute(text, source, version_of(root))
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        pages = {
            "Source": source,
            "Documentation": f"{source}/blob/main/docs/index.md",
            "Changelog": f"{source}/blob/main/CHANGELOG.md",
            "Issues": f"{source}/issues",
        }
        metadata["urls"] = pages if source else {}
