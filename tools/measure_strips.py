"""How wide search strips may be with each built-in receiver, and how many flights along them hear the weakest set."""

from __future__ import annotations

from arva_hil.campaign.range_test.strips import strip_width
from arva_hil.config import parse
from arva_hil.config.profiles import builtin_files


def main() -> None:
    for name in builtin_files():
        if name.startswith("receivers/"):
            profile = name.removeprefix("receivers/")
            text = f"spec: 2\ntransmitters: [{{id: 1, ned: [0, 0, 0]}}]\nreceiver: {{profile: 'builtin:{profile}'}}"
            width = strip_width(parse(text, profile), 3.0, 1.0)
            print(
                f"{profile:16}", f"{width.metres:5.1f} m {width.detection:6.1%}" if width else "too little for strips"
            )


if __name__ == "__main__":
    main()
