"""Every limit that decides what discovery says: what it decides, and why it has its value.

docs/discovery_details.md shows them as a table, which `table` writes and a test compares.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limit:
    """A limit."""

    name: str
    """As in the code."""
    value: float
    """In the unit that `decides` states; without unit otherwise."""
    decides: str
    """What it decides."""
    why: str
    """Why it has this value."""


LIMITS: list[Limit] = []
"""All of them."""


def _limit(name: str, value: float, decides: str, why: str) -> float:
    LIMITS.append(Limit(name, value, decides, why))
    return value


def table() -> str:
    """Write all limits as a table in Markdown."""
    rows = [f"| `{one.name}` | {one.value:g} | {one.decides} | {one.why} |" for one in LIMITS]
    return "\n".join(["| limit | value | decides | why |", "| --- | --- | --- | --- |", *rows])


HEALTHY = _limit(
    "HEALTHY", 0.5, "prior probability that no further effect is there", "nothing is preferred"
)
FALSE_ALARMS = _limit(
    "FALSE_ALARMS",
    0.01,
    "share of healthy robots in which an effect may be named, if the model of them is true",
    "usual",
)
LIKELY = _limit(
    "LIKELY",
    1.1,
    "logarithm of the odds from which the first effect is told as an ambiguous answer, with a "
    "baseline",
    "a probability of three quarters; of 16 healthy development robots, 15 had odds of at most "
    "0.3, and one with a single axis had 9.4",
)
OF_MODEL = _limit(
    "OF_MODEL",
    9.0,
    "how much larger the logarithm of the odds has to be without a baseline, and for a torque of "
    "no known form",
    "signatures of a model are not exact; on development robots false effects reached 12.5 in all, "
    "and true ones began at 16. A torque of no known form takes up errors of any model",
)
LAW_ERROR = _limit(
    "LAW_ERROR",
    0.03,
    "share of what a known effect, or a law with its numbers, explains that a further or unknown "
    "effect, or a further curve of a learned law, has to exceed, and that the error of a law may "
    "shift to a rival of the same law on the same axis",
    "real effects differ from their laws by some 17 %, of which the square is left over; assumed",
)
FORM_ERROR = _limit(
    "FORM_ERROR",
    0.005,
    "share of the evidence for an effect that the error of its law may shift to a rival",
    "0.1 x 0.1 x 0.5: real effects differ by some 10 %, half of which resembles another; assumed",
)
MOST_EFFECTS = int(_limit("MOST_EFFECTS", 6, "effects in one robot", "assumed"))
CREDIBLE = _limit("CREDIBLE", 0.95, "probability of a set of rivals", "usual")
AGAINST = _limit(
    "AGAINST",
    3.0,
    "logarithm of the ratio by which motions that were not fitted refute an effect, and by which "
    "each axis has to agree with a factor of a log of all axes, and one factor to exceed another",
    "20 to 1, usual",
)
OF_EVIDENCE = _limit(
    "OF_EVIDENCE",
    0.05,
    "the same, as a further share of the evidence for the effect",
    "no law is exact; true effects of development robots had up to 0.07 in all, false ones from "
    "0.1 on",
)
MODEL_VARIANCE = _limit(
    "MODEL_VARIANCE",
    6.0,
    "mean square of the whitened error on motions that were not fitted, over its expectation, from "
    "which a model is not good enough",
    "logarithms of odds are as many times too large: 100 to 1 is 2 to 1; healthy robots of other "
    "simulators have 1 to 3.5",
)
MODEL_ERROR = _limit(
    "MODEL_ERROR",
    0.5,
    "torque error of the calibrated model over the torque, from which it is none",
    "it explains less than three quarters of the squared torque; assumed",
)
UNRESOLVED = _limit(
    "UNRESOLVED",
    0.5,
    "change of the bristles' deflection (-1 to 1) between samples, from which a reversal happens "
    "between them and is not used",
    "a quarter of a whole reversal; assumed",
)
FALL = _limit(
    "FALL",
    18.0,
    "fall of minus two times the log likelihood from which an effect may be named, in plans and in "
    "the search for places",
    "odds of 100 to 1 in favour of one of 100 effects and axes",
)
PROMISING = _limit(
    "PROMISING", 0.75, "share of `FALL` from which an effect is simulated at a place", "assumed"
)
AGAIN = _limit(
    "AGAIN",
    2.0,
    "standard errors of an effect at a place without its most telling pass",
    "what happens once is at some place too; usual",
)
ORDER_CHANCE = _limit(
    "ORDER_CHANCE", 1e-4, "probability that noise alone shows a wave of some order", "assumed"
)
NAMED_SHARE = _limit(
    "NAMED_SHARE",
    0.8,
    "share of what can be explained, below which effects are only a part",
    "stated in the verdict",
)
CONSIDERABLE = _limit(
    "CONSIDERABLE",
    0.25,
    "squared error beyond that of noise, over that of noise, from which a gap is open",
    "assumed",
)
USUAL_SHOWN = _limit(
    "USUAL_SHOWN",
    3.0,
    "standard errors from which a difference that a healthy robot may have is told",
    "usual; nothing is named by it",
)
CURVE_GAIN = _limit(
    "CURVE_GAIN",
    20.0,
    "fall of the squared whitened error of predictions by a curve of a learned law",
    "assumed",
)
CURVE_CHANCE = _limit(
    "CURVE_CHANCE",
    1e-3,
    "probability that this error does not fall",
    "about seven blocks of 0.25 s have to show it, so that no single event makes a law",
)
LAW_SIZE = _limit(
    "LAW_SIZE",
    0.005,
    "RMS of a learned law over the RMS torque of its axis without a baseline",
    "usual error of a calibrated model; assumed",
)
LAW_SHOWN = _limit(
    "LAW_SHOWN", 0.3, "share of a learned law that its simulation has to show", "assumed"
)
LAW_SAME = _limit(
    "LAW_SAME",
    0.95,
    "correlation with an effect from which a law is that effect, which was not found missing",
    "assumed",
)
LAW_CERTAIN = _limit(
    "LAW_CERTAIN", 0.98, "probability of a learned law from which it changes a verdict", "assumed"
)
LAW_ALONE = _limit(
    "LAW_ALONE",
    1.01,
    "gap of a law alone over that with effects, up to which they are superfluous",
    "assumed",
)
LAW_ALIKE = _limit(
    "LAW_ALIKE",
    0.8,
    "correlation with an effect up to which a law is another one, and the effect loses its name",
    "assumed",
)
FALSE_DISCOVERIES = _limit(
    "FALSE_DISCOVERIES", 0.05, "share of false ones among the regimes that are told", "usual"
)
LOG_CERTAIN = _limit(
    "LOG_CERTAIN",
    10.0,
    "log likelihood ratio from which sign or unit of a log is corrected",
    "odds of 400 to 1 if one log in fifty is wrong; right signs of five machines and laboratories "
    "were at 16 or more, wrong ones at 2.3 at most",
)
LOG_GAIN = _limit(
    "LOG_GAIN",
    3.0,
    "gain of a log beyond which it is not left to calibration",
    "torque constants and masses of models are not that wrong; assumed",
)
LOG_UNUSUAL = _limit(
    "LOG_UNUSUAL",
    5.0,
    "standard deviations of healthy logs from which gain or zero of a log is told",
    "assumed",
)
SERVO_SURE = _limit(
    "SERVO_SURE",
    8.0,
    "standard errors from which the equation of the servo shows a fault",
    "assumed",
)
SERVO_PLAIN = _limit(
    "SERVO_PLAIN",
    1e-3,
    "delay [s] that the equation has to show on all axes before it alone decides on delays",
    "assumed",
)
SHORTEST_DELAY = _limit(
    "SHORTEST_DELAY",
    2e-4,
    "delay [s] from which it is told",
    "a fifth of a cycle of a bus of 1 kHz; where the servo is known to 13 % only, 0.17 ms was seen "
    "on a healthy development robot",
)
SMALLEST_ERROR = _limit(
    "SMALLEST_ERROR",
    2e-5,
    "amplitude [rad] from which a transmission error is told",
    "four seconds of arc, about a tenth of what exact gearboxes have (30 to 60): rings that "
    "smoothing has changed looked like up to 3.3",
)
SHORTEST_SHARE = _limit(
    "SHORTEST_SHARE",
    0.25,
    "delay, over the sample period, from which a comparison of torques tells it",
    "smoothing moves reversals by as much: 0.15 to 0.2 on development robots",
)
NO_TORQUE = _limit(
    "NO_TORQUE",
    0.9,
    "error of a fit with free parameters over the deviation, from which a log is no torque",
    "assumed",
)
OTHERS_FINE = _limit(
    "OTHERS_FINE", 0.5, "the same of the best axis, up to which the model can be right", "assumed"
)
