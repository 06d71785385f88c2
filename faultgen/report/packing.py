"""Numbers in a page, in the form in which plotly.js reads them fastest."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import ArrayLike


def packed(values: ArrayLike) -> dict[str, str]:
    """Numbers in the form in which plotly.js reads them fastest: 4 bytes each, as base64.

    Args:
        values: Shape (n,). What is not finite becomes a gap.
    """
    numbers = np.asarray(values, dtype="<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(numbers.tobytes()).decode()}
