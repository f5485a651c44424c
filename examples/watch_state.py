"""May the map be acted on right now? Follows map and state, and says when that changes, and why.

python examples/watch_state.py [ENDPOINT]     beside `echogrid replay DRIVE --publish`, or a service in a car
"""

import argparse
import sys
import time
from contextlib import suppress

from echogrid.client import Client, vehicles
from echogrid.errors import EchogridError

OLDEST = 0.5  # s without a new map or status after which nothing is certain, whatever was said before
STATUS_EVERY = 2.5  # s: it comes once a second


class Trust:
    """Remembers when map and status came last, and what the status said. Time is given, so that it can be tried without a car."""

    def __init__(self) -> None:
        self.map_at = self.status_at = float("-inf")
        self.state, self.reasons = "unknown", ["no status yet"]

    def verdict(self, now: float) -> tuple[str, str]:
        """go: all radars; slow: a part of the surroundings is not watched; stop: the map is not of now."""
        if now - self.status_at > STATUS_EVERY or now - self.map_at > OLDEST:
            return "stop", f"no map for {now - self.map_at:.1f} s" if now - self.map_at > OLDEST else "no status"
        why = "; ".join(self.reasons)
        return {"ok": ("go", why), "degraded": ("slow", why)}.get(self.state, ("stop", why))


def main(endpoint: str) -> None:
    names = vehicles(endpoint, timeout=20.0)
    if not names:
        sys.exit(f"{endpoint}: no vehicle within 20 s; is a service running there?")
    trust, said, begun = Trust(), "", time.monotonic()
    with Client(endpoint, names[0]) as client:
        while (now := time.monotonic()) < max(trust.status_at, begun) + 10.0:  # ends when the vehicle is gone for good
            if client.grid(timeout=0.1) is not None:
                trust.map_at = time.monotonic()
            if (status := client.status(timeout=0.0)) is not None:
                trust.status_at, trust.state, trust.reasons = time.monotonic(), status["state"], status["reasons"]
            verdict, why = trust.verdict(now)
            if verdict != said:
                said = verdict
                print(f"{verdict}{': ' + why if why else ''}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("endpoint", nargs="?", default="tcp/127.0.0.1:7447", help="where the service listens")
    with suppress(KeyboardInterrupt):  # Ctrl-C ends it
        try:
            main(parser.parse_args().endpoint)
        except EchogridError as error:  # is a sentence for who typed the endpoint
            sys.exit(str(error))
