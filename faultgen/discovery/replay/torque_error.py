"""The torque error of a model on a recording, relative to the torque."""

from __future__ import annotations

import numpy as np

from faultgen.errors import InputError
from faultgen.recordings.recording import Recording


def relative_errors(square: np.ndarray, recording: Recording, inside: np.ndarray) -> np.ndarray:
    """Compute the RMS error of each axis divided by its RMS torque in the whole recording.

    An axis may rest without torque at the samples that are used. Its noise there must not look like
    a large error.

    Args:
        square: Squared error of each sample, or of each axis; shape (samples, n_axes) or (n_axes,).
        recording: The recording with the torque.
        inside: Samples that are used, shape (samples, n_axes).

    Returns:
        Shape (n_axes,), without unit; 0 for axes without torque, or of which no sample is used.
    """
    torque = np.mean(recording.torque**2, axis=0)
    wrong = np.where(inside, square, 0.0).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)
    return np.sqrt(np.where(torque > 0, wrong / np.where(torque > 0, torque, 1.0), 0.0))


def relative_error(square: np.ndarray, recording: Recording, inside: np.ndarray) -> float:
    """Compute the root mean square of `relative_errors` over the axes that have torque.

    Args:
        square: As for `relative_errors`.
        recording: The recording with the torque.
        inside: Samples that are used, shape (samples, n_axes).

    Returns:
        The relative error, without unit.

    Raises:
        InputError: No sample can be used.
    """
    by_axis = relative_errors(square, recording, inside)
    seen = np.any(inside & (recording.torque != 0), axis=0)
    if not seen.any():
        raise InputError(
            f"{recording.source}: no sample can be used; give a recording with more motion"
        )
    return float(np.sqrt(np.mean(by_axis[seen] ** 2)))
