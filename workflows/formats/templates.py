"""Pages are filled from templates of jinja2, which stand beside the code that fills them."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1]  # workflows/, below which templates have their names


def render(template: str, **values: object) -> str:
    """Return the text of a template, named by its place below workflows/, with its values put in.

    In a template whose name ends in .html values are escaped; a value that is `Markup` is not.

    Raises:
        KeyError: the template asks for a value that is not given.
    """
    from jinja2 import UndefinedError

    try:
        text: str = _environment().get_template(template).render(values)
        return text
    except UndefinedError as error:
        raise KeyError(f"{template}: {error}") from error


@cache
def _environment() -> Any:
    """Return what finds templates; a line that holds a statement alone leaves nothing."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

    return Environment(
        loader=FileSystemLoader(FOLDER, followlinks=True),
        undefined=StrictUndefined,
        autoescape=select_autoescape(["html"]),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
