"""The version out of tags, a changelog and what else a clone has."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from packaging.version import Version
from release.build import section, sound
from release.version import ReleaseError, debian, head_of, version
from tests.support.places import ROOT

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
ENVIRONMENT = {
    "PATH": os.environ["PATH"],
    **{f"GIT_{who}_{what}": "x@localhost" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")},
    "GIT_COMMITTER_DATE": "2026-01-02T05:04:05+0200",
    "GIT_CONFIG_GLOBAL": os.devnull,
}


def git(folder: Path, *arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def commit(folder: Path, head: str) -> str:
    """The hash of a commit whose changelog begins so."""
    (folder / "CHANGELOG.md").write_text(f"# Changelog\n\n## {head}\n\n- More.\n\n## 0.0.9, 2020-01-01\n\n- Less.\n")
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "-m", "more")
    return git(folder, "rev-parse", "HEAD")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "origin"
    made.mkdir()
    git(made, "init", "--quiet", "--initial-branch=main")
    return made


def test_a_tag_names_the_version_and_nothing_else_does(folder: Path) -> None:
    found = commit(folder, "1.10.0, not released")
    between = f"1.10.0.dev20260102030405+g{found[:9]}"
    for other in ("vintage", "1.10.0", "v1.10", "v1.10.0rc1"):
        git(folder, "tag", other)
    assert version(folder) == between
    git(folder, "tag", "v1.9.0")
    git(folder, "tag", "-m", "with a message", "v1.10.0")
    assert version(folder) == "1.10.0"
    (folder / "new").write_text("that git does not know")
    assert version(folder) == "1.10.0"
    (folder / "CHANGELOG.md").write_text("## 1.10.0, not released\n")
    assert version(folder) == f"{between}.changed"


def test_versions_follow_each_other(folder: Path) -> None:
    before = version_of(folder, "1.2.3, not released")
    after = version_of(folder, "1.2.3, 2026-01-02")
    later = version_of(folder, "1.3.0, not released")
    assert Version(before) < Version("1.2.3") < Version(after) < Version(later) < Version("1.3.0")
    if shutil.which("dpkg") is not None:
        ordered = [debian(one) for one in (before, "1.2.3", after, later, "1.3.0")]
        for older, newer in itertools.pairwise(ordered):
            subprocess.run(["dpkg", "--compare-versions", older, "lt", newer], check=True)


def version_of(folder: Path, head: str) -> str:
    commit(folder, head)
    return version(folder)


def test_clones_without_tags_or_history_have_the_same(folder: Path, tmp_path: Path) -> None:
    commit(folder, "1.2.3, not released")
    git(folder, "tag", "v1.2.3")
    commit(folder, "1.3.0, not released")
    git(tmp_path, "clone", "--quiet", "--depth=1", "--no-tags", f"file://{folder}", "shallow")
    assert git(tmp_path / "shallow", "rev-list", "--count", "HEAD") == "1"
    assert version(tmp_path / "shallow") == version(folder)


def test_files_without_git_have_the_changelogs(folder: Path) -> None:
    commit(folder, "9.9.9, not released")
    (folder / "inside").mkdir()  # of another project's checkout
    (folder / "inside" / "CHANGELOG.md").write_text("# Changelog\n\n## 1.2.3, not released\n")
    assert version(folder / "inside") == "1.2.3.dev0"


def test_where_git_does_not_answer_that_is_said(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    commit(folder, "1.2.3, not released")
    monkeypatch.setenv("PATH", os.devnull)
    assert version(folder) == "1.2.3.dev0"
    assert capsys.readouterr().err == "version: git, which knows more, is not installed; so this one is called 1.2.3.dev0\n"
    monkeypatch.undo()
    (folder / ".git" / "HEAD").unlink()
    assert version(folder) == "1.2.3.dev0"
    assert capsys.readouterr().err.startswith("version: git tag: fatal: not a git repository")


def test_a_changelog_without_a_head_is_refused(tmp_path: Path) -> None:
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## Unreleased\n")
    with pytest.raises(ReleaseError, match=r"CHANGELOG.md: has no head such as '## 1\.2\.3, 2026-01-31'"):
        version(tmp_path)


def test_ours_goes_together() -> None:
    """A tag that stands on another version than the changelog's would be refused; and the head can be read."""
    number, date = head_of(ROOT)
    sound(f"{number}.dev0")
    with pytest.raises(ReleaseError, match=f"its head is '{number}, {date}' and the tag v99.0.0, expected '99.0.0' and the date"):
        sound("99.0.0")


def test_a_section_is_all_between_two_heads() -> None:
    newer, older = "## 1.2.3, 2026-01-02\n\n- a\n  b\n\n### More\n\n- d\n", "## 1.2.2, 2026-01-01\n\n- e\n"
    changelog = f"# Changelog\n\n## 1.2.30, not released\n\n- c\n\n{newer}\n{older}"
    assert section(changelog, "1.2.3") == newer
    assert section(changelog, "1.2.2") == older
    with pytest.raises(ReleaseError, match=r"says nothing of 1\.2\.1"):
        section(changelog, "1.2.1")
