"""The gallery of effects: a small picture and a sentence for each, on one page without other files.

The curves are stored with the package. `benchmarks/pages/effect_signatures.py` simulates them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from typing import Any

import numpy as np
from markupsafe import Markup

from faultgen.effects import EFFECTS, Effect
from faultgen.report.page import page

_WIDTH, _HEIGHT, _MARGIN = 240.0, 110.0, 5.0  # of a picture, in its own units


def gallery_page() -> str:
    """Make the page.

    Returns:
        The HTML of the page, with every effect of the catalogue. An effect of an installed package
        has no picture.
    """
    text = resources.files("faultgen.report").joinpath("gallery.json").read_text("utf-8")
    known = json.loads(text)
    return page(
        "gallery.html", effects=[_card(one, known.get(one.name)) for one in EFFECTS.values()]
    )


def _card(effect: Effect, told: dict[str, Any] | None) -> dict[str, Any]:
    """What the template shows of an effect."""
    card: dict[str, Any] = {
        "name": effect.name,
        "what": _sentence(effect.description),
        "shows": _sentence(effect.signature),
        "unit": effect.unit,
        "range": f"{effect.smallest:g} to {effect.largest:g}",
        "source": effect.source,
        "parameters": ", ".join(f"{name} = {value}" for name, value in _short(effect).items()),
        "case": "",
        "pictures": [],
    }
    if told is not None:
        card["case"] = f"{effect.shown(told['severity'])}, axis {told['axis']} of the IRB 6700"
        card["pictures"] = [
            {"drawn": picture(**one), "x": one["x_title"], "y": one["y_title"]}
            for one in reversed(told["charts"])
        ]
    return card


def _short(effect: Effect) -> dict[str, Any]:
    """Parameters with their defaults; a default that is a list is not shown."""
    return {
        name: "of the gearbox" if value is None else value
        for name, value in effect.parameters.items()
        if not isinstance(value, list | dict)
    }


def picture(
    *, x: Sequence[float], y: Sequence[Sequence[float]], lines: bool, x_title: str, y_title: str
) -> Markup:
    """Draw curves as SVG, the last of them in the colour of faults.

    Args:
        x: Places of the values, shape (n,).
        y: Values of each curve, shape (curves, n).
        lines: Whether the values are joined by lines.
        x_title: Title of the horizontal axis, for those who cannot see the picture.
        y_title: Title of the vertical axis.

    Returns:
        The picture, without titles. A horizontal line shows where the values are 0.
    """
    places, values = np.asarray(x, float), np.asarray(y, float)
    low, high = min(values.min(), 0.0), max(values.max(), 0.0)
    across = _scaled(places, places.min(), places.max(), _WIDTH)
    up = _HEIGHT - _scaled(values, low, high, _HEIGHT)
    zero = _HEIGHT - float(_scaled(np.zeros(1), low, high, _HEIGHT)[0])
    drawn = [f'<path class="zero" d="M0 {zero:.1f}H{_WIDTH:g}"/>']
    for number, row in enumerate(up):
        kind = "faulty" if number == len(up) - 1 else "healthy"
        points = [f"{a:.1f} {b:.1f}" for a, b in zip(across, row, strict=True)]
        # a line without length has round ends, so that it is a dot
        path = "M" + "L".join(points) if lines else "".join(f"M{one}h0" for one in points)
        drawn.append(f'<path class="{kind}{"" if lines else " dots"}" d="{path}"/>')
    label = f"{y_title} over {x_title}: {values[-1].min():.3g} to {values[-1].max():.3g}"
    return Markup('<svg viewBox="0 0 {:g} {:g}" role="img" aria-label="{}">{}</svg>').format(
        _WIDTH, _HEIGHT, label, Markup("".join(drawn))
    )


def _scaled(values: np.ndarray, low: float, high: float, size: float) -> np.ndarray:
    """Places of values in a picture that shows a range."""
    share = (values - low) / (high - low) if high > low else np.full(values.shape, 0.5)
    return np.asarray(_MARGIN + share * (size - 2 * _MARGIN))


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
