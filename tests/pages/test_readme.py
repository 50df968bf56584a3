"""The pages' outside: README, the citation, the page of messages, and the docstrings of public names."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest
import yaml

import arva_hil
import firmware_proto
from arva_hil.config import DEFAULT
from arva_hil.records.ros_messages.readings import LiveMessages
from arva_hil.records.ros_messages.types import MAP
from tools.__main__ import PROGRAMS

from .pages import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
DOI = "10.1109/ICRA40945.2020.9196914"


def test_it_is_short() -> None:
    assert len(README.split()) < 900


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_what_it_links_to_is_there(page: str) -> None:
    targets = re.findall(r"\]\(([^)#]+)", (ROOT / page).read_text(encoding="utf-8"))
    assert targets
    assert [target for target in targets if not target.startswith("https:") and not (ROOT / target).exists()] == []


def test_an_environment_is_named_before_any_pip() -> None:
    assert README.index("-m venv") < README.index("pip install")


def test_the_safety_of_the_bench_comes_before_the_first_cable() -> None:
    safety = README.index("Propellers off")
    assert safety < README.index("3.3 V") < README.index("who has the sticks") < README.index("/dev/ttyUSB0", safety)


def test_the_citation_is_this_version_and_names_the_paper() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert citation["version"] == arva_hil.__version__
    assert citation["license"] == "MIT"
    assert [paper["doi"] for paper in citation["references"]] == [DOI]
    assert DOI in README


def test_pictures_are_small() -> None:
    assert Path(ROOT / "docs/pictures/demo.gif").stat().st_size < 1_000_000
    assert [
        path for path in (ROOT / "docs/pictures").glob("*.png") if path.stat().st_size > 300_000
    ] == []  # the demo keeps all its colours


def test_how_to_cite_has_this_version_and_the_paper() -> None:
    page = (ROOT / "docs/cite.md").read_text(encoding="utf-8")
    assert f"{{{arva_hil.__version__}}}" in page
    assert DOI in page


def test_the_list_of_tools_has_every_program() -> None:
    rows = re.findall(r"(?m)^\| (`.*?) \|", (ROOT / "tools/README.md").read_text(encoding="utf-8"))
    named = {name for row in rows[1:] for name in re.findall(r"`([a-z ]+)`", row)}
    assert named == set(PROGRAMS)


# -- the page of ROS 2 messages and the view of RViz name what is published ------------------------------------


TOPICS = LiveMessages(DEFAULT, 0, searches=True).topics


def test_the_page_has_every_topic_with_its_message() -> None:
    text = (ROOT / "docs/reference/messages.md").read_text()
    listed = dict(re.findall(r"^\| `(/[a-z_/]+)` \| `(\w+/msg/\w+)` \|", text, re.MULTILINE))
    assert listed == {topic: kind.__msgtype__ for topic, kind in TOPICS.items()}


def test_the_view_of_rviz_shows_topics_that_are_there() -> None:
    view = yaml.safe_load((ROOT / "tools/ros2/arva_hil.rviz").read_text())["Visualization Manager"]
    assert view["Global Options"]["Fixed Frame"] == MAP
    shown = {display["Topic"]["Value"] for display in view["Displays"] if "Topic" in display}
    assert shown == {"/arva/visualization", "/arva/pose", "/search/visualization"}
    assert shown <= set(TOPICS)


# -- every public name, and what is public of it, says what it is ----------------------------------------------


NUMBERS = re.compile(r"\bfloat\b|NDArray|ArrayLike|\bArray\b")
IN_THE_NAME = re.compile(r"_(m|s|hz|deg|rad|us|ms|cm|m_s)$")
IN_WORDS = re.compile(
    r"\bm\b|\bs\b|\bms\b|\bcm\b|m²|m/s|A/m|µs|°|Hz|dB|metres?\b|seconds?\b|degrees?\b|radians?\b|bytes?\b|ratio|units\b|NED\b"
)
ANY_UNIT = {"Number", "Whole"}  # bounds of a key's value, in the unit of the key


def public() -> dict[str, object]:
    """Names and their objects, and those of the public functions and properties of classes."""
    found: dict[str, object] = {}
    for package in (arva_hil, firmware_proto):
        for name in package.__all__:
            item = getattr(package, name)
            if not callable(item):
                continue
            found[name] = item
            if inspect.isclass(item):
                for part, value in vars(item).items():
                    function = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
                    if not part.startswith("_") and inspect.isfunction(function):
                        found[f"{name}.{part}"] = getattr(item, part)
    return found


def test_every_public_name_has_a_docstring() -> None:
    names = public()
    assert len(names) > 80
    assert [name for name, item in names.items() if not inspect.getdoc(item)] == []


def test_every_quantity_has_its_unit_in_its_name_or_in_the_docstring() -> None:
    lacking, names = [], public()
    for name, item in names.items():
        callable_ = inspect.isclass(item) or inspect.isfunction(item) or inspect.ismethod(item)
        raised = inspect.isclass(item) and issubclass(item, Exception)
        if name in ANY_UNIT or raised or not callable_:
            continue
        said = f"{inspect.getdoc(item)} {inspect.getdoc(names[name.partition('.')[0]])}"  # or for a whole class
        for parameter in inspect.signature(item).parameters.values():
            number = NUMBERS.search(str(parameter.annotation))
            if number and not IN_THE_NAME.search(parameter.name) and not IN_WORDS.search(said):
                lacking.append(f"{name}: {parameter.name}")
    assert not lacking, "\n".join(lacking)
