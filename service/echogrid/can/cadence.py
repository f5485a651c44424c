"""A message's counter against its period: tells lost frames from time that jumped."""

from __future__ import annotations

from statistics import median

NS = 1e-9
FIRST = 5  # steps whose median the period begins with: a cycle that is missing among them does not count
JUMP = 0.2  # s: less is a frame that waited
UNCOUNTED = 3  # periods that a sender may leave out without counting them
LONGEST = 1.0  # s: after a longer silence, or jump, the sender has restarted
GAIN = 0.05  # share of the lag that is taken for jitter and drift
STEPS = 1000.0  # whose mean the period is
REGULAR = 0.2  # of the period: a step that differs by more does not count for it
LATELY, FEWEST = 2.0, 20  # s and steps after which their median and mean may say that the period is another
STEADY, FOLLOWS = 0.6, 0.3  # share of them that are alike; of their mean, where fewer are
WAITED = 1.0  # s in which frames that waited catch up: what looked left out was a stall of who stamps them


class Cadence:
    """Remembers the last number and when it came, and the period.

    `lag` is by how many seconds time has run ahead of the counter: about 0, until time jumps by more than JUMP; then it stays, until
    time jumps back. `missing` frames were lost before the last one, by their counters.
    """

    def __init__(self, bits: int) -> None:
        self.size = 1 << bits  # numbers that the counter has
        self.lag = 0.0
        self.missing = 0
        self._elapsed = 0.0  # s, the last step
        self._first: list[float] = []  # s, the first steps
        self._period = 0.0  # s; 0 before it is known
        self._steps = 1.0
        self._last: tuple[int, int] | None = None  # number, ns
        self._lately: list[float] = []  # s, the last steps
        self._for = 0.0  # s, their sum
        self._steady = True  # whether most of them are alike
        self._left_out = 0  # periods of late without a frame that the counter does not tell
        self._left_out_ns = 0

    def add(self, number: int, received_ns: int) -> None:
        last, self._last = self._last, (number, received_ns)
        if last is None:
            return
        counted = (number - last[0]) % self.size
        self.missing = counted - 1 if counted else 0
        self._elapsed = elapsed = (received_ns - last[1]) * NS
        if counted == 0 or not 0.0 <= elapsed < LONGEST:
            self.lag = 0.0
            return
        if self._period == 0.0:
            self._first += [elapsed / counted] if elapsed > 0 else []
            self._period = median(self._first) if len(self._first) == FIRST else 0.0
            return
        period, step = self._period, elapsed / counted
        self._lately.append(step)
        self._for += step
        if not -0.5 < elapsed / period - counted < 0.5:
            periods = round(elapsed / period)
            rounds, off = divmod(periods - counted + 1, self.size)
            assumed = rounds * self.size if off <= 2 else 0  # the counter went round, or back: two in the wrong order
            skipped = periods - counted - assumed
            assumed += skipped if 0 < skipped <= UNCOUNTED else 0
            counted += assumed
            if assumed > 0:
                self._left_out, self._left_out_ns = self._left_out + assumed, received_ns
        if self._left_out and (received_ns - self._left_out_ns) * NS > WAITED:
            self._left_out = 0
        if counted <= 0:
            self.missing = 0
        lag = self.lag + elapsed - counted * period
        if self._left_out and (early := min(round(-lag / period), self._left_out)) > 0:  # no frame comes before it is sent
            self._left_out -= early
            lag += early * period
        if -JUMP < lag < JUMP:
            lag -= lag * GAIN
            if counted > 0 and self._steady:
                longer, most = elapsed / counted - period, REGULAR * period
                if -most < longer < most or self._steps < 3:
                    if self._steps < STEPS:
                        self._steps += 1.0
                    self._period = period + longer / self._steps
        self.lag = lag if -LONGEST < lag < LONGEST else 0.0
        if self._for >= LATELY and len(self._lately) >= FEWEST:
            self._correct_period()

    @property
    def missed(self) -> int:
        """As `missing`, but no more than the time before the last one had room for."""
        if not self.missing or not self._period:
            return self.missing
        return min(self.missing, max(round(self._elapsed / self._period) - 1, 0))

    def _correct_period(self) -> None:
        """The first steps may have been a stall: median and mean of the last ones must not both say otherwise.

        Where most steps are irregular, those that are like the period would draw it to where they are most: then it follows the mean.
        """
        mean, middle = self._for / len(self._lately), median(self._lately)
        most = REGULAR * middle
        regular = sum([-most < step - middle < most for step in self._lately]) / len(self._lately)
        self._steady = regular > STEADY
        if min(mean, middle) > (1 + REGULAR) * self._period or max(mean, middle) < (1 - REGULAR) * self._period:
            self._period, self._steps, self.lag = mean, 1.0, 0.0
        elif not self._steady:
            self._period += (mean - self._period) * FOLLOWS
        self._lately.clear()
        self._for = 0.0
