"""Self-contained HTML pages."""

from __future__ import annotations

import base64
import html
import io

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto }}
table {{ border-collapse: collapse; font-size: 13px; margin: 1rem 0 }}
th, td {{ border: 1px solid #ccc; padding: .2rem .5rem; text-align: left }}
figure {{ margin: 1rem 0 }} figcaption {{ color: #555; font-size: 13px }}
th {{ background: #f2f2f2 }} img {{ max-width: 100% }} pre {{ background: #f6f6f6; padding: 1rem }}
</style></head><body>
{body}
</body></html>
"""


def page(title: str, body: str) -> str:
    """Make a complete HTML page with its style.

    Args:
        title: Title of the page, in plain text.
        body: Content of the page, in HTML.

    Returns:
        The HTML of the page.
    """
    return _PAGE.format(title=html.escape(title), body=body)


def image(figure: Figure, caption: str) -> str:
    """Turn a figure into HTML that contains the image itself, and close the figure.

    Args:
        figure: The figure.
        caption: Its caption, in plain text.

    Returns:
        The HTML of the figure.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    plt.close(figure)
    data = base64.b64encode(buffer.getvalue()).decode()
    text = html.escape(caption)
    shown = f'<img alt="{text}" src="data:image/png;base64,{data}">'
    return f"<figure>{shown}<figcaption>{text}</figcaption></figure>"
