"""python -m tests.judging [DRIVE …]: the table in docs/checking.md, over the shipped drive, a drawn one and other drive folders."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from tests.judging.mistakes import PLANTED, Planted
from tests.judging.trial import check, drive, found, mended, others, shipped, winding


def table(drives: Iterable[tuple[str, Planted]]) -> None:
    """Rows of Markdown."""
    for name, sound in drives:
        base = {finding.code for finding, _ in check(sound)}
        print(f"\n## {name}: {sorted(base) or 'nothing'} said of it as it is\n")
        scores = []
        for mistake in PLANTED:
            said = check(mistake.plant(sound))
            scores.append((found(mistake, said), mended(mistake, sound, said)))
            extra = [code for code in others(mistake, said) if code not in base]
            print(f"| {mistake.name} | {mistake.code} | {scores[-1][0]} | {scores[-1][1]} | {', '.join(extra)} |", flush=True)
            if not all(scores[-1]):
                for finding, fix in said:
                    print(
                        "      ",
                        finding.code,
                        finding.radars,
                        finding.sentence,
                        f"{finding.confidence:.2f}",
                        fix.config,
                        fix.profiles,
                        fix.says,
                    )
        print(f"found {sum(one for one, _ in scores)} of {len(scores)}, mended {sum(one for _, one in scores)}")


if __name__ == "__main__":
    table([("winding", winding()), ("shipped", shipped()), *((folder, drive(Path(folder))) for folder in sys.argv[1:])])
