"""The states that a drive went through: their changes as they come, the seconds of each, the maps that were begun and why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from echogrid.core.trust.watch import QUIET_NS, State

LOOK_S = 0.1  # s of the drive between two looks
QUIET_S = QUIET_NS * 1e-9  # without a frame, beyond which a service would call its map stale
HARMLESS_S = 1.0  # until the first map there is none, and not every radar has been heard: that is no fault
MOST = 500  # changes that are kept
SAY_S, MOST_SAID = 1.0, 40  # a line a second of the drive at most, and so many in all
GRAVITY = ("ok", "degraded", "no_motion", "stale")
TRUSTED = ("ok", "degraded")


@dataclass(slots=True)
class StateLog:
    """Remembers each state's seconds, the changes, and the maps. `say` is told what changed, now and then."""

    say: Callable[[str], None] | None = None
    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(GRAVITY, 0.0))
    changes: list[dict[str, Any]] = field(default_factory=list)
    left_out: int = 0  # changes beyond MOST
    maps: list[dict[str, Any]] = field(default_factory=list)
    worst: str = "ok"
    begun: bool = False  # whether there was a map at all
    _well: bool = False  # whether it was ok at all
    _silent: float = 0.0  # s without a frame: the recording was stopped, or the car's buses slept
    _told: str | None = None  # the state that the changes end with
    _last: State | None = None
    _looked: float | None = None  # s of the drive
    _said: float = -SAY_S
    _lines: int = 0

    def due(self, time: float) -> bool:
        """Whether to look again. `time`: s since the drive's begin."""
        return self._looked is None or time - self._looked >= LOOK_S

    def look(self, time: float, state: State) -> None:
        """The state at a time of the drive; seconds count for the state that was seen last, and are stale where no frame came."""
        self._pass(time)
        self._note(time, state)

    def _pass(self, time: float) -> None:
        """Until then no frame came."""
        if self._looked is None or self._last is None or time - self._looked <= QUIET_S + LOOK_S or self._last.name == "stale":
            return
        quiet = time - self._looked
        self._silent += quiet - QUIET_S
        self._note(self._looked + QUIET_S, State("stale", (f"nothing received for {quiet:.1f} s",)))

    def _note(self, time: float, state: State) -> None:
        if self._looked is not None and self._last is not None and time > self._looked:
            self.seconds[self._last.name] += time - self._looked
        self._looked = time if self._looked is None else max(time, self._looked)
        self._last = state
        self._told = self._told or state.name
        self.begun = self.begun or state.name in TRUSTED
        self._well = self._well or state.name == "ok"
        if not self._well and time <= HARMLESS_S:
            return
        if GRAVITY.index(state.name) > GRAVITY.index(self.worst):
            self.worst = state.name
        if state.name == self._told:
            return
        self._told = state.name
        reason = state.reasons[0] if state.reasons else ""
        if len(self.changes) < MOST:
            self.changes.append({"s": round(time, 2), "state": state.name, "reason": reason})
        else:
            self.left_out += 1
        first = len(self.changes) == 1 and state.name == "ok"  # that the first map has begun is no news
        if not first:
            self._tell(time, f"{state.name}: {reason}" if reason else state.name)

    def new_map(self, time: float, why: str) -> None:
        """Another map was begun."""
        self._pass(time)
        if len(self.maps) < MOST:
            self.maps.append({"s": round(time, 2), "why": why})
        self._tell(time, f"new map: {why}", always=True)

    def trusted(self) -> str | None:
        """None where the map can be trusted; else why not."""
        whole = sum(self.seconds.values()) - self._silent
        good = sum(self.seconds[name] for name in TRUSTED)
        if self._last is not None and self._last.name not in TRUSTED:
            return f"it ends {self._last.name}: {self._last.reasons[0]}" if self._last.reasons else f"it ends {self._last.name}"
        return None if good >= 0.5 * whole else f"only {good:.1f} of {whole:.1f} s were ok or degraded"

    def _tell(self, time: float, what: str, *, always: bool = False) -> None:
        if self.say is None or self._lines > MOST_SAID or (time - self._said < SAY_S and not always):
            return
        self._said = time
        self._lines += 1
        self.say(f"{time:8.1f} s  {what}" if self._lines <= MOST_SAID else "            and so on: see summary.json")
