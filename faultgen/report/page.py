"""Self-contained HTML pages, made from the templates in the folder ``templates``."""

from __future__ import annotations

import base64
import io
from importlib import resources
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt
from markupsafe import Markup

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TEMPLATES = Environment(
    loader=PackageLoader("faultgen.report"),
    autoescape=True,
    undefined=StrictUndefined,  # a value that is not given is an error, not an empty text
    trim_blocks=True,
    lstrip_blocks=True,
)


def script(name: str) -> str:
    """Read a script that pages contain, or that a server sends.

    Args:
        name: Name of a file in the folder ``scripts``.

    Returns:
        Its text.
    """
    return resources.files("faultgen.report").joinpath("scripts", name).read_text("utf-8")


_TEMPLATES.globals["script"] = lambda name: Markup(script(name))


def page(template: str, **values: Any) -> str:
    """Make a complete HTML page.

    Args:
        template: Name of a file in the folder ``templates``.
        values: Values of the names that the template uses. Texts are plain text, except those that
            `markdown` returns.

    Returns:
        The HTML of the page.
    """
    return _TEMPLATES.get_template(template).render(values)


def image(figure: Figure) -> str:
    """Turn a figure into an address that contains the image itself, and close the figure.

    Args:
        figure: The figure.

    Returns:
        A data URI with the image as PNG.
    """
    import matplotlib.pyplot as plt  # takes a second, and most pages have no such image

    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    plt.close(figure)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def markdown(text: str) -> Markup:
    """Turn Markdown into HTML.

    Args:
        text: Paragraphs and tables in Markdown. HTML within it is shown as it is written.

    Returns:
        The HTML, which templates do not escape again.
    """
    return Markup(MarkdownIt("js-default", {"breaks": True}).render(text))
