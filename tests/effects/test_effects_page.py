"""docs/effects.md is that of the catalogue."""

from pathlib import Path

import matplotlib.image
import numpy as np
from pages.effect_cases import CASES, MOTIONS
from pages.effect_signatures import FOLDER, PAGE, page

from faultgen.effects import EFFECTS


def test_every_effect_has_its_entry():
    """In the order of the catalogue; the page is what the script writes."""
    assert list(CASES) == list(EFFECTS)
    assert PAGE.read_text() == page()
    for name, case in CASES.items():
        effect = EFFECTS[name]
        assert case.motion in MOTIONS, name
        assert effect.smallest <= case.severity <= effect.largest, name
        assert case.axis in effect.axes(6), name
        effect.complete(case.parameters)


def test_every_effect_has_its_picture():
    """One each and no other, 700 points wide, small, and something on it."""
    assert {path.stem for path in Path(FOLDER).glob("*")} == set(EFFECTS)
    for name in EFFECTS:
        path = FOLDER / f"{name}.png"
        assert path.stat().st_size < 60_000, name
        image = matplotlib.image.imread(path)
        assert image.shape[1] == 700, name
        red = (image[..., 0] > 0.6) & (image[..., 1:3] < 0.3).all(axis=-1)
        assert np.count_nonzero(red[:, 350:]) > 100, name  # the gap
