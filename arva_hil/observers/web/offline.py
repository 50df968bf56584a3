"""A record as one file: the page with its data, played by a browser without a server."""

from __future__ import annotations

import base64
import gzip
import json
import re
from typing import Any, Final

import numpy as np

from arva_hil.observers.web.server import pages
from arva_hil.observers.web.viewer import RecordedState

MOST_READINGS: Final = 40_000  # of all receivers
MOST_MOMENTS: Final = 400  # between two of them the search, the vehicles and the links do not change
_MOST_FIELDS: Final = 16  # pictures of the field's lines
_NOTHING_LOADED: Final = (
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline' data:; "
    "style-src 'unsafe-inline'; img-src data:\">"
)


def offline_page(state: RecordedState) -> bytes:
    """Return the HTML file of a record."""
    files = {path[1:]: content.body.decode() for path, content in pages().items()}
    packed = base64.b64encode(gzip.compress(json.dumps(_data(state), separators=(",", ":")).encode(), mtime=0)).decode()
    modules = {  # they import others by their names in the map
        name: _link("text/javascript", text.replace('from "./', 'from "'))
        for name, text in files.items()
        if name.endswith(".js") and name != "uplot.js"
    }
    scripts = (
        f"<script>{files['uplot.js']}</script>"
        f'<script type="importmap">{json.dumps({"imports": modules})}</script>'
        f'<script type="application/octet-stream" id="record">{packed}</script>'
        '<script type="module">import "offline.js"; await import("app.js");</script>'
    )
    styles = f"<style>{files['uplot.css']}{files['style.css']}</style>"
    html = re.sub(r"<(link|script)\b[^>]*(href|src)=[^>]*>(</script>)?\n", "", files[""])
    html = html.replace("icon.svg", _link("image/svg+xml", files["icon.svg"]))
    return html.replace("</head>", f"{_NOTHING_LOADED}{styles}{scripts}</head>").encode()


def _data(state: RecordedState) -> dict[str, Any]:
    """Return the moments, each with what has changed since the one before, the field's lines, and all readings."""
    moments, fields, before = list[dict[str, Any]](), list[Any](), dict[str, Any]()
    for n, time_s in enumerate(np.linspace(*state.span_s, MOST_MOMENTS).tolist()):
        state.show(time_s)
        now = json.loads(state.document(state.version))
        if n % (MOST_MOMENTS // _MOST_FIELDS) == 0 and (not fields or fields[-1]["version"] != now["field"]):
            fields.append(json.loads(state.field()))
        now["field"] = fields[-1]["version"]
        del now["version"], now["time_s"], now["events"], now["full"], now["all_events"]
        moments.append({key: value for key, value in now.items() if before.get(key, before) != value})
        before = now
    readings = [one["points"] for one in json.loads(state.document())["receivers"]]
    stride = -(-sum(map(len, readings)) // MOST_READINGS) or 1
    kept = [points[(len(points) - 1) % stride :: stride] for points in readings]
    if before["background"]:
        picture = base64.b64encode(state.background()).decode()
        for moment in moments:
            if moment.get("background"):
                moment["background"]["from"] = f"data:image/png;base64,{picture}"
    return {"moments": moments, "fields": fields, "readings": kept, "timeline": json.loads(state.time_line())}


def _link(kind: str, text: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(text.encode()).decode()}"
