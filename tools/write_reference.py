"""Writes what follows from the declarations in arva_hil/config: the JSON Schemas there and docs/scenario.md."""

from __future__ import annotations

from pathlib import Path

from arva_hil.config.reference import FILES, page, schema_text

ROOT = Path(__file__).parent.parent


def main() -> None:
    for kind in FILES:
        (ROOT / f"arva_hil/config/{kind}.schema.json").write_text(schema_text(kind), encoding="utf-8")
    (ROOT / "docs").mkdir(exist_ok=True)
    (ROOT / "docs/scenario.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
