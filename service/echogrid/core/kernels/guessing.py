"""The reference's loop that finds the motion which most detections agree with."""

from __future__ import annotations

import numpy as np

from echogrid.core.kernels.cells import Floats, Integers, Mask


def common_motion(
    cos: Floats,
    sin: Floats,
    rate: Floats,
    sizes: Integers,
    places: Floats,
    one: Integers,
    other: Integers,
    apart: float,
    tolerance: float,
    out: Floats,
    explained: Mask,
) -> None:
    """Of guesses from pairs of detections, `one` and `other` (P,), the motion that explains the most range rates (N,) to `tolerance` m/s,
    refined by least squares over those: out (3,) is speed (m/s), yaw rate (rad/s) and whether any pair was `apart` enough, by its
    determinant; `explained` (N,) by the refined one.

    Detections by the cosine and sine (N,) of their bearing in base, scan by scan: `sizes` (S,) with places (S, 3), x and y of the sensor
    (m) and the Doppler ambiguity interval (m/s, 0: none), modulo which rates are compared. Sums go from the first detection to the last.
    """
    x, y, interval = np.repeat(places, sizes, axis=0).T
    slope = np.stack((-cos, y * cos - x * sin), axis=1)  # (N, 2) derivatives of a standing point's range rate by speed and yaw rate

    def left_by(motion: Floats) -> Floats:
        """(..., N) of the range rates, by motions (..., 2)."""
        left = rate - (motion[..., :1] * slope[:, 0] + motion[..., 1:] * slope[:, 1])
        known = np.where(interval > 0, interval, 1.0)
        found: Floats = np.where(interval > 0, left - known * np.rint(left / known), left)
        return found

    (a, b), (c, d), p, q = slope[one].T, slope[other].T, rate[one], rate[other]
    determinant = a * d - b * c
    enough = np.abs(determinant) > apart
    out[:], explained[:] = 0.0, False
    if not enough.any():
        return
    guesses = np.stack((p * d - b * q, a * q - p * c), axis=1)[enough] / determinant[enough, None]
    best = guesses[(np.abs(left_by(guesses)) < tolerance).sum(axis=1).argmax()]
    left = left_by(best)
    chosen = np.abs(left) < tolerance
    (u, v), r = slope[chosen].T, left[chosen]
    uu, uv, vv, ur, vr = (np.add.accumulate(terms)[-1] for terms in (u * u, u * v, v * v, u * r, v * r))
    out[:2] = best + np.array((ur * vv - uv * vr, uu * vr - ur * uv)) / (uu * vv - uv * uv)
    out[2] = 1.0
    explained[:] = np.abs(left_by(out[:2])) < tolerance
