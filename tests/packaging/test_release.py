"""What the built package says of itself, and that version, tag, CHANGELOG and CITATION.cff agree."""

from __future__ import annotations

import email
import re
import shutil
import subprocess
from email.message import Message
from pathlib import Path
from typing import Any

import pytest

import arva_hil
from hatch_build import LongDescription
from tools.check_release import ROOT, Said, Tags, disagreements, said, tags

SOURCE = "https://example.net/someone/arva-hil"
GOOD = Said("1.2.0", "1.2.0 (unreleased)", "1.2.0", SOURCE)
RELEASED = GOOD._replace(changelog="1.2.0 (2026-12-01)")


@pytest.fixture(scope="module")
def metadata(tmp_path_factory: pytest.TempPathFactory) -> Message:
    """As it is in the wheel, by the hook that a build calls."""
    build = pytest.importorskip("hatchling.build", reason="pip install hatchling")
    folder = tmp_path_factory.mktemp("metadata")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        name = build.prepare_metadata_for_build_wheel(str(folder))
    return email.message_from_string((folder / name / "METADATA").read_text(encoding="utf-8"))


def test_the_long_description_has_no_relative_link(metadata: Message) -> None:
    text = str(metadata.get_payload())
    targets = re.findall(r"\]\(([^)]*)\)", text)
    assert targets
    assert [target for target in targets if not re.match(r"https?://|#", target)] == []
    assert not re.search(r"(?i)<(a|img)\b[^>]*(href|src)=\"(?!https?:)", text)


@pytest.fixture
def described() -> dict[str, Any]:
    """The dynamic keys of a project with an address."""
    keys: dict[str, Any] = {}
    LongDescription(str(ROOT), {"source": SOURCE}).update(keys)
    return keys


def test_its_links_lead_to_files_of_the_project_and_its_pictures_to_their_bytes(described: dict[str, Any]) -> None:
    text = described["readme"]["text"]
    there = re.findall(rf"(!?)\[[^\]]*\]\({re.escape(SOURCE)}/(blob|raw)/v([^/]+)/([^)#]+)", text)
    assert len(there) > 30
    assert {version for _, _, version, _ in there} == {arva_hil.__version__}
    assert [path for _, _, _, path in there if not (ROOT / path).exists()] == []
    assert {kind for picture, kind, _, _ in there if picture} == {"raw"}


def test_it_names_its_addresses(described: dict[str, Any]) -> None:
    assert set(described["urls"]) == {"Source", "Documentation", "Changelog", "Issues"}
    assert all(address.startswith(SOURCE) for address in described["urls"].values())


def test_it_names_the_versions_of_python_it_runs_on_and_no_made_up_address(metadata: Message) -> None:
    versions = [c.rpartition(" ")[2] for c in metadata.get_all("Classifier", []) if ":: Python :: 3." in c]
    assert versions == ["3.11", "3.12", "3.13", "3.14"]
    assert "example.org" not in str(metadata)
    assert bool(metadata.get_all("Project-URL")) == bool(said().source)


def test_here_all_agree() -> None:
    assert said().version == arva_hil.__version__
    assert disagreements(said(), tags()) == []


@pytest.mark.parametrize(
    ("files", "there"),
    [
        (GOOD, Tags()),
        (GOOD, Tags(newest="1.1.9")),
        (GOOD._replace(version="1.10.0", changelog="1.10.0", citation="1.10.0"), Tags(newest="1.9.0")),
        (RELEASED, Tags("1.2.0", "1.2.0")),
    ],
)
def test_nothing_is_said_where_all_agree(files: Said, there: Tags) -> None:
    assert disagreements(files, there) == []


@pytest.mark.parametrize(
    ("files", "there", "found"),
    [
        (GOOD._replace(changelog="1.1.0 (2026-01-01)"), Tags(), "CHANGELOG.md begins with 1.1.0"),
        (GOOD._replace(citation="1.1.0"), Tags(), "CITATION.cff says 1.1.0"),
        (GOOD, Tags(newest="1.2.0"), "v1.2.0 is tagged already"),
        (GOOD, Tags(newest="1.10.0"), "v1.10.0 is tagged already"),
        (RELEASED, Tags("1.3.0", "1.3.0"), "this commit is tagged v1.3.0, the version is 1.2.0"),
        (GOOD, Tags("1.2.0", "1.2.0"), "CHANGELOG.md says (unreleased)"),
        (RELEASED._replace(source=""), Tags("1.2.0", "1.2.0"), "the project has no address"),
        (RELEASED._replace(news=("a.md",)), Tags("1.2.0", "1.2.0"), "changelog.d has a.md"),
    ],
)
def test_what_does_not_agree_is_said(files: Said, there: Tags, found: str) -> None:
    (one,) = disagreements(files, there)
    assert found in one


@pytest.mark.skipif(not shutil.which("git"), reason="no git")
def test_tags_are_read_and_others_than_versions_are_none(tmp_path: Path) -> None:
    def git(*words: str) -> None:
        subprocess.run(["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b.c", *words], check=True)

    assert tags(tmp_path) == Tags()
    git("init", "-q")
    git("commit", "-q", "--allow-empty", "-m", "one")
    git("tag", "nightly")
    assert tags(tmp_path) == Tags()
    git("tag", "v0.9.0")
    assert tags(tmp_path) == Tags("0.9.0", "0.9.0")
    git("commit", "-q", "--allow-empty", "-m", "two")
    assert tags(tmp_path) == Tags(None, "0.9.0")
