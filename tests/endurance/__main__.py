"""python -m tests.endurance soak [--minutes 30] | load [--seconds 20] | distance [--kilometres 100] | kill [--times 200]

Measures, prints, and writes into out/endurance.
"""

from __future__ import annotations

import argparse
import json
import logging
from pathlib import Path
from tempfile import TemporaryDirectory

from echogrid.config.loading import load_config
from echogrid.pipeline import Pipeline
from tests.endurance.distance import distance
from tests.endurance.kill import kills, summary
from tests.endurance.load import loads, measure
from tests.endurance.soak import soak
from tests.support.places import DEMO


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.endurance")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("soak").add_argument("--minutes", type=float, default=30.0)
    commands.add_parser("load").add_argument("--seconds", type=float, default=20.0)
    commands.add_parser("distance").add_argument("--kilometres", type=float, default=100.0)
    commands.add_parser("kill").add_argument("--times", type=int, default=200)
    parser.add_argument("--out", type=Path, default=Path("out/endurance"))
    options = parser.parse_args()
    logging.basicConfig(level=logging.WARNING)
    if options.command == "soak":
        result: object = soak(DEMO, options.out, options.minutes)
    elif options.command == "distance":
        result = distance(DEMO, options.out, options.kilometres)
    elif options.command == "kill":
        with TemporaryDirectory() as folder:
            result = summary(kills(Path(folder), options.times))
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "kill.json").write_text(json.dumps(result, indent=1) + "\n")
    else:
        source = DEMO / "echogrid.toml"
        config = load_config(source, "analytic")
        ids = [number for number, _ in Pipeline(config, source).signals.ids(config.radar[0].bus)]
        result = [measure(DEMO, load, options.seconds) for load in loads(ids)]
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "load.json").write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
