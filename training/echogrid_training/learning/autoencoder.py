"""The paper's network: a DCGAN-like convolutional autoencoder from a radar image to log-odds of occupancy.

echogrid-train fit --drives drives --out models/paper --network paper --weighting independent --epochs 30 --seed 1
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

CELLS = 128  # along a side of the image
CHANNELS = 1  # of the image: where static detections lie
LEVELS = (1, 2, 4, 8, 8)  # channels after each halving, in widths: 64, 32, 16, 8, 4 cells a side
SLOPE = 0.2  # of LeakyReLU below 0, as in DCGAN


class PaperAutoencoder(nn.Module):
    """(B, planes, 128, 128) -> logits (B, answers, 128, 128), or (B, 128, 128) of one. The paper's have one of each: an image in [-1, 1],
    and logits of which the loss compares tanh(logits / 2) with labels in [-1, 1].

    From the paper: strided convolutions, deconvolutions, LeakyReLU, batch norm in all layers, one last convolution that makes the image
    and evens out the deconvolutions' checkerboard. Its figure is not in the text, so depth, kernels and widths are our choice: k4 s2 down
    to a code of 4 x 4 as in DCGAN. Width 16 has 0.87 million weights, width 32 has 3.5.
    """

    def __init__(self, width: int = 16, planes: int = CHANNELS, answers: int = 1) -> None:
        super().__init__()
        self.width = width
        down = (planes, *(level * width for level in LEVELS))
        up = (*down[:0:-1], width)
        self.encoder = nn.Sequential(*(halved(*pair) for pair in pairwise(down)))
        self.decoder = nn.Sequential(*(doubled(*pair) for pair in pairwise(up)))
        self.head = nn.Conv2d(width, answers, kernel_size=3, padding=1)
        for name, weight in self.named_parameters():
            if weight.dim() == 4:  # He's start for LeakyReLU; DCGAN's sigma of 0.02 is for one width
                nn.init.kaiming_normal_(weight, SLOPE, mode="fan_out" if name.startswith("decoder") else "fan_in")

    def forward(self, image: Tensor) -> Tensor:
        code = self.encoder(image)  # (B, 8 width, 4, 4)
        logits: Tensor = self.head(self.decoder(code))  # (B, answers, 128, 128)
        return logits[:, 0] if logits.shape[1] == 1 else logits


def halved(channels: int, out: int) -> nn.Sequential:
    """(B, channels, H, W) -> (B, out, H / 2, W / 2)."""
    return nn.Sequential(nn.Conv2d(channels, out, 4, stride=2, padding=1, bias=False), nn.BatchNorm2d(out), nn.LeakyReLU(SLOPE))


def doubled(channels: int, out: int) -> nn.Sequential:
    """(B, channels, H, W) -> (B, out, 2 H, 2 W)."""
    return nn.Sequential(nn.ConvTranspose2d(channels, out, 4, stride=2, padding=1, bias=False), nn.BatchNorm2d(out), nn.LeakyReLU(SLOPE))


def decayed(model: nn.Module) -> tuple[list[nn.Parameter], list[nn.Parameter]]:
    """The weights of convolutions, which decay pulls to 0, and all others: biases and batch norms."""
    weights = [weight for weight in model.parameters() if weight.dim() > 1]
    others = [weight for weight in model.parameters() if weight.dim() <= 1]
    return weights, others


def squared(model: nn.Module) -> Tensor:
    """Scalar: the sum of the squares of all that is learned, which the paper adds to its loss."""
    return torch.stack([weight.square().sum() for weight in model.parameters()]).sum()


def weight_count(model: nn.Module) -> int:
    """All that is learned."""
    return sum(weight.numel() for weight in model.parameters())


def probe(seed: int, occupied: int, batch: int = 1) -> Tensor:
    """(batch, 1, 128, 128) images with at most `occupied` detections each at random cells: to compare two networks with."""
    generator = torch.Generator().manual_seed(seed)
    image = torch.full((batch, CHANNELS * CELLS * CELLS), -1.0)
    image.scatter_(1, torch.randint(CHANNELS * CELLS * CELLS, (batch, occupied), generator=generator), 1.0)
    return image.view(batch, CHANNELS, CELLS, CELLS)
