"""Several GPUs or machines under `torchrun`: every process learns from its share of each batch, and all take the same step.

torchrun --nproc-per-node 4 -m echogrid_training fit --drives drives --out models/default
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel


@dataclass(frozen=True, slots=True)
class Ranks:
    """This process among all; alone it is the first of one."""

    rank: int
    world: int
    device: torch.device

    @property
    def writes(self) -> bool:
        """Whether this process writes logs and checkpoints."""
        return self.rank == 0

    def share(self, batch: NDArray[np.intp]) -> NDArray[np.intp]:
        """Of a batch's samples, those that this process learns from."""
        return batch[self.rank :: self.world]

    def wrapped(self, model: nn.Module) -> nn.Module:
        """The model whose gradients are the mean over all processes."""
        return DistributedDataParallel(model) if self.world > 1 else model


@contextmanager
def joined_ranks() -> Iterator[Ranks]:
    """As torchrun's variables say; leaves the group at the end."""
    world, rank, local = (int(os.environ.get(name, default)) for name, default in (("WORLD_SIZE", "1"), ("RANK", "0"), ("LOCAL_RANK", "0")))
    cuda = torch.cuda.is_available()
    device = torch.device("cuda", local) if cuda else torch.device("cpu")
    if world == 1:
        yield Ranks(0, 1, device)
        return
    distributed.init_process_group("nccl" if cuda else "gloo")
    try:
        yield Ranks(rank, world, device)
    finally:
        distributed.destroy_process_group()
