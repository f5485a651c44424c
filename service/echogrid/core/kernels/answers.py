"""The reference's loops around a network: its image folded, its answer unfolded into odds."""

from __future__ import annotations

import numpy as np

from echogrid.core.kernels.cells import Bytes, Singles

LOG2_E = np.float32(1.44269502)
LN2_HIGH, LN2_LOW = np.float32(0.693359375), np.float32(2.12194440e-4)  # ln 2 is the first less the second; k times the first is exact
FACTORIALS = [np.float32(c) for c in (1.98412698e-4, 1.38888889e-3, 8.33333333e-3, 4.16666667e-2, 1.66666667e-1, 0.5, 1.0, 1.0)]


def fold(image: Bytes, out: Bytes) -> None:
    """Space to depth: (C, 2 H, 2 W) -> (4 C, H, W), channel 4 c + 2 (i mod 2) + (j mod 2) as in torch's pixel_unshuffle."""
    channels, height, width = image.shape
    blocks = image.reshape(channels, height // 2, 2, width // 2, 2)
    out[:] = blocks.transpose(0, 2, 4, 1, 3).reshape(out.shape)


def odds(planes: Singles, out: Singles) -> None:
    """Class logits of free, unknown and occupied, folded (12, H, W) -> (2, 2 H, 2 W): log-odds of occupied, and how sure it is that the
    cell is not unknown, 0 … 1."""
    _, height, width = planes.shape
    free, unknown, occupied = planes.reshape(3, 2, 2, height, width).transpose(0, 3, 1, 4, 2).reshape(3, 2 * height, 2 * width)
    out[0] = occupied - free
    rest = np.clip(unknown - np.maximum(free, occupied), np.float32(-60), np.float32(60))
    known = 1 + exponential(np.maximum(-np.abs(out[0]), np.float32(-60)))
    out[1] = known / (known + exponential(rest))


def exponential(x: Singles) -> Singles:
    """exp(x) for |x| <= 87, to 2e-7 of it: by sums and products alone, which are the same everywhere, while libraries' differ."""
    k = np.trunc(x * LOG2_E + np.where(x < 0, np.float32(-0.5), np.float32(0.5)))
    r = x - k * LN2_HIGH + k * LN2_LOW
    p = FACTORIALS[0]
    for factor in FACTORIALS[1:]:
        p = p * r + factor
    power: Singles = ((k.astype(np.int32) + 127) << 23).view(np.float32)
    return p * power
