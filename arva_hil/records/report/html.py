"""Pages of HTML from templates, with the style that all reports share (`templates/base.html`)."""

from __future__ import annotations

from typing import Any

import jinja2

from arva_hil import __version__


def render(package: str, template: str, **values: Any) -> str:
    """Return a page from a template of a package of ours. All values are escaped."""
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(package), jinja2.PackageLoader("arva_hil.records.report")]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(version=__version__, **values)
