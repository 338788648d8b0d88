from __future__ import annotations

from pathlib import Path

import pytest
from markupsafe import Markup

from stickslip.workflows.formats import templates
from stickslip.workflows.formats.templates import render


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(templates, "FOLDER", tmp_path)
    monkeypatch.setattr(templates, "_environment", templates._environment.__wrapped__)  # that of the folder
    return tmp_path


def test_text_is_escaped_in_html_alone(folder: Path) -> None:
    for name in ("page.html", "page.md"):
        (folder / name).write_text("{{ words }} {{ markup }}\n")
    values = {"words": "a < b", "markup": Markup("<b>c</b>")}
    assert render("page.html", **values) == "a &lt; b <b>c</b>\n"
    assert render("page.md", **values) == "a < b <b>c</b>\n"


def test_a_line_with_a_statement_alone_leaves_nothing(folder: Path) -> None:
    (folder / "list.md").write_text("A\n{% for x in xs %}\n* {{ x }}\n{% endfor %}\nB")
    assert render("list.md", xs=[1, 2]) == "A\n* 1\n* 2\nB"


def test_a_value_that_is_not_given_is_refused(folder: Path) -> None:
    (folder / "page.md").write_text("{{ missing }}")
    with pytest.raises(KeyError, match="missing"):
        render("page.md")
