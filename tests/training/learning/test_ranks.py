"""Several processes, one network: torchrun on this machine, two ranks, no network beyond the loopback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.places import ROOT

from echogrid_training.learning.ranks import Ranks, joined_ranks

FIT = """
import os, sys
from pathlib import Path
import torch
from tests.support.rectangles import rectangles
from echogrid_training.learning.train import Settings, fit

out = Path(sys.argv[1])
settings = Settings("paper", epochs=2, seed=6, width=4, batch=4, per_epoch=8, rate=1e-2)
trained = fit(rectangles(10, 1), rectangles(4, 2), settings, out)
torch.save(trained.weights, out / f"rank{os.environ['RANK']}.pt")
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a run of two ranks left behind, with the weights that each ended with."""
    folder = tmp_path_factory.mktemp("ranks")
    (folder / "fit.py").write_text(FIT)
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", str(folder / "fit.py"), str(folder)]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "GLOO_SOCKET_IFNAME": "lo", "CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return folder


def test_all_ranks_end_with_the_same_weights(out: Path) -> None:
    """Though each has seen only its half of every batch."""
    one, other = (torch.load(out / f"rank{rank}.pt", weights_only=True) for rank in range(2))
    assert one.keys() == other.keys()
    learned = [name for name in one if "running" not in name and "num_batches" not in name]
    assert len(learned) > 20
    for name in learned:
        assert torch.equal(one[name], other[name]), name


def test_only_the_first_writes(out: Path) -> None:
    """One log of two epochs, one checkpoint, one model: its own."""
    assert len((out / "log.jsonl").read_text().splitlines()) == 2
    assert len(list(out.glob("events.out.tfevents.*"))) == 1
    kept = torch.load(out / "model.pt", weights_only=True)["weights"]
    first = torch.load(out / "rank0.pt", weights_only=True)
    assert all(torch.equal(kept[name], first[name]) for name in first)


@pytest.mark.parametrize("world", [1, 2, 3])
def test_the_shares_of_a_batch_are_the_batch(world: int) -> None:
    batch = np.random.default_rng(1).permutation(64)[:13]
    shares = [Ranks(rank, world, torch.device("cpu")).share(batch) for rank in range(world)]
    assert sorted(np.concatenate(shares).tolist()) == sorted(batch.tolist())
    assert max(len(share) for share in shares) - min(len(share) for share in shares) <= 1


def test_alone_it_is_the_first_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("WORLD_SIZE", "RANK", "LOCAL_RANK"):
        monkeypatch.delenv(name, raising=False)
    with joined_ranks() as ranks:
        model = torch.nn.Linear(2, 2)
        assert (ranks.rank, ranks.world, ranks.writes) == (0, 1, True)
        assert ranks.wrapped(model) is model
