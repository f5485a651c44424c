"""The default network: a small U-Net from the twelve planes of echogrid.core.evidence.history_raster to three classes.

echogrid-train fit --drives drives --out models/default --network default --epochs 12 --seed 1
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, pixel_shuffle, pixel_unshuffle

PLANES, CLASSES = 12, 3  # in and out: free, unknown, occupied
WIDTHS = (32, 48, 64, 96)  # channels at 64, 32, 16 and 8 cells a side
CLASS_WEIGHTS = (0.35, 0.35, 2.3)  # of the cross-entropy: mild, for occupied cells are 2 in 100


class UNet(nn.Module):
    """(B, planes, 128, 128) of bytes / 255 -> class logits (B, 3, 128, 128).

    Blocks of 2 x 2 cells are folded into channels first and unfolded last, where the service's raster and numpy do it for less than the
    network; `core` is what is exported between: (B, 4 planes, 64, 64) -> (B, 12, 64, 64). ReLU and no deconvolution, for both have int8
    kernels.
    """

    def __init__(self, widths: Sequence[int] = WIDTHS, planes: int = PLANES) -> None:
        super().__init__()
        self.core = Core(widths, planes)

    def forward(self, image: Tensor) -> Tensor:
        return pixel_shuffle(self.core(pixel_unshuffle(image, 2)), 2)


class Core(nn.Module):
    def __init__(self, widths: Sequence[int], planes: int) -> None:
        super().__init__()
        first, *deeper = widths
        self.stem = nn.Sequential(conv(4 * planes, first), conv(first, first))
        self.down = nn.ModuleList()
        self.narrow, self.merge = nn.ModuleList(), nn.ModuleList()
        above = first
        for width in deeper:
            self.down.append(nn.Sequential(conv(above, width, stride=2), conv(width, width)))
            self.narrow.insert(0, conv(width, above, kernel=1))
            self.merge.insert(0, conv(2 * above, above))
            above = width
        self.head = nn.Conv2d(first, 4 * CLASSES, kernel_size=3, padding=1)
        self.reset()

    def reset(self) -> None:
        """He's start, and a head that at first says next to nothing of any class."""
        for weight in self.parameters():
            if weight.dim() == 4:
                nn.init.kaiming_normal_(weight, mode="fan_out", nonlinearity="relu")
        nn.init.normal_(self.head.weight, std=0.01)

    def forward(self, folded: Tensor) -> Tensor:
        seen = [self.stem(folded)]
        for down in self.down:
            seen.append(down(seen[-1]))
        x = seen.pop()
        for narrow, merge in zip(self.narrow, self.merge, strict=True):
            x = merge(torch.cat((interpolate(narrow(x), scale_factor=2.0, mode="nearest"), seen.pop()), dim=1))
        logits: Tensor = self.head(x)
        return logits


def conv(channels: int, out: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    """Convolution, batch norm, ReLU."""
    return nn.Sequential(
        nn.Conv2d(channels, out, kernel, stride=stride, padding=kernel // 2, bias=False), nn.BatchNorm2d(out), nn.ReLU(inplace=True)
    )


def corrected(logits: Tensor, weights: Sequence[float] = CLASS_WEIGHTS) -> Tensor:
    """Class logits (B, 3, H, W) of the classes' own shares, of those that a weighted cross-entropy taught: less ln(weight)."""
    return logits - torch.tensor([math.log(weight) for weight in weights], device=logits.device).view(1, -1, 1, 1)


def evenly(logits: Tensor, shares: Tensor) -> Tensor:
    """(B, H, W) in [-1, 1]: what to say of a cell if all three classes were equally common, as the paper's class MSE weighs them.

    logits: corrected class logits (B, 3, H, W); shares: (3,) of the classes in what was learned from. The mean of the label over the
    classes' probabilities, each divided by its share: the least squared error there is.
    """
    p = torch.softmax(logits - torch.log(shares).view(1, -1, 1, 1).to(logits), dim=1)
    return p[:, 2] - p[:, 0]
