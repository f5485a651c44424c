"""The decoders in docs/interface.md, in C++ and Rust, compiled as they stand there: they read what is published, and refuse the rest."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from tests.support.documents import blocks
from tests.support.places import DOCS
from tests.support.waiting import PATIENCE

from echogrid.topics.grids import Grid, encode_grid

# What is put behind the document's program: it reads a message, and says what is in it, or ends with 3.
MAINS = {
    "cpp": """
#include <iostream>
#include <iterator>
int main() {
    std::cin >> std::noskipws;
    const std::vector<std::uint8_t> bytes((std::istreambuf_iterator<char>(std::cin)), {});
    try {
        const Grid grid = decode_grid(bytes);
        std::cout.precision(17);
        std::cout << grid.stamp_ns << ' ' << grid.frame << ' ' << grid.cell << ' ' << grid.width << ' ' << grid.height;
        std::cout << ' ' << grid.x << ' ' << grid.y;
        for (const int cell : grid.data) std::cout << ' ' << cell;
    } catch (const std::runtime_error&) {
        return 3;
    }
}
""",
    "rust": """
fn main() {
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::io::stdin(), &mut bytes).unwrap();
    let Some(grid) = decode_grid(&bytes) else { std::process::exit(3) };
    let [x, y] = grid.origin;
    print!("{} {} {} {} {} {x} {y}", grid.stamp_ns, grid.frame, grid.cell, grid.width, grid.height);
    for cell in grid.data {
        print!(" {cell}");
    }
}
""",
}
COMPILERS = {
    "cpp": ("g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", "-fno-sanitize-recover"),
    "rust": ("rustc", "--edition=2021", "-Dwarnings"),
}
GRIDS = [
    Grid(1_700_000_000_123_456_789, "odom", 0.25, (-3.5, 7.25), np.array([[-1, 0, 100], [3, 50, 97]], np.int8)),
    Grid(5, "a longer frame", 0.5, (1e6, -2.0), np.full((7, 1), -1, np.int8)),
    Grid(0, "", 1.0, (0.0, 0.0), np.zeros((0, 0), np.int8)),
]


@pytest.fixture(scope="module", params=sorted(COMPILERS))
def decoder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program; the document's second one in that language wants Zenoh, and says why it is not run."""
    language, compiler = request.param, COMPILERS[request.param]
    if shutil.which(compiler[0]) is None:
        pytest.skip(f"there is no {compiler[0]} here")
    first, second = (block for block in blocks(DOCS / "interface.md") if block.language == language)
    assert not first.marks
    assert second.marks
    folder = tmp_path_factory.mktemp(language)
    source, program = folder / f"decoder.{'rs' if language == 'rust' else language}", folder / "decoder"
    source.write_text(first.text + MAINS[language])
    done = subprocess.run([*compiler, str(source), "-o", str(program)], capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return program


def decoded(program: Path, message: bytes) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([str(program)], input=message, capture_output=True, timeout=PATIENCE, check=False)


@pytest.mark.parametrize("grid", GRIDS, ids=lambda grid: grid.frame or "empty")
def test_what_is_encoded_is_read(decoder: Path, grid: Grid) -> None:
    done = decoded(decoder, encode_grid(grid))
    assert done.returncode == 0
    height, width = grid.occupancy.shape
    stamp, rest = done.stdout.decode().split(" ", 1)
    assert int(stamp) == grid.stamp_ns
    assert rest.startswith(grid.frame + " ")
    numbers = [float(word) for word in rest.removeprefix(grid.frame).split()]
    assert numbers == [grid.cell, width, height, *grid.origin, *grid.occupancy.ravel().tolist()]


def test_what_is_cut_off_or_says_another_size_is_refused(decoder: Path) -> None:
    """At places all over the message: nothing behind its end is read."""
    message = encode_grid(GRIDS[0])
    for end in (0, 3, 4, 9, 15, 20, 30, 37, 50, len(message) - 7, len(message) - 1):
        assert decoded(decoder, message[:end]).returncode == 3, end
    place = len(message) - GRIDS[0].occupancy.size - 4  # of the number of cells
    assert decoded(decoder, message[:place] + b"\xff\xff\xff\xff" + message[place + 4 :]).returncode == 3
    assert decoded(decoder, message[:12] + b"\xff\xff\xff\xff" + message[16:]).returncode == 3  # of the frame's letters
