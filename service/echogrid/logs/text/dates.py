"""Dates in the heads of recordings. A head names no time zone: it is taken as UTC, so that a file is the same everywhere."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation

MONTHS = {  # as Windows abbreviates them: English, German, French, Spanish, Italian, Dutch, Portuguese, Swedish, Polish
    1: "jan ene gen sty",
    2: "feb fév fev lut",
    3: "mar mär mrz mrt maa",
    4: "apr avr abr kwi",
    5: "may mai mag mei maj",
    6: "jun jui giu cze",
    7: "jul lug lip",
    8: "aug aoû ago sie",
    9: "sep set wrz",
    10: "oct okt ott out paź",
    11: "nov lis",
    12: "dec dez déc dic dez gru",
}
MONTH = {name: month for month, names in MONTHS.items() for name in names.split()} | {"juil": 7, "juin": 6, "maja": 5}
CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})(?:[.,:](\d{1,9}))?(?:[.,:]\d{1,3})?\s*([ap]m)?", re.IGNORECASE)
DAY_FIRST, YEAR_FIRST = re.compile(r"\b(\d{1,2})[./](\d{1,2})[./](\d{4})\b"), re.compile(r"\b(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})\b")
WORDS, NUMBERS = re.compile(r"[^\W\d_]{3,}"), re.compile(r"\b\d+\b")
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
DAY_ZERO = datetime(1899, 12, 30, tzinfo=UTC)  # of PEAK's day numbers


def seconds_of(text: str) -> float | None:
    """A written date as seconds since 1970, or None where it cannot be read: "Sun Sep 13 12:26:40.000 pm 2020", "13.09.2020 12:26:40.0"."""
    clock = CLOCK.search(text)
    if clock is None:
        return None
    hour, minute, second = (int(part) for part in clock.groups()[:3])
    half = (clock[5] or "").lower()
    if half and hour <= 12:  # there are writers that put "pm" behind 15:06 as well
        hour = hour % 12 + 12 * (half == "pm")
    day = _day(text[: clock.start()] + " " + text[clock.end() :])
    if day is None:
        return None
    try:
        when = datetime(*day, hour, minute, second, int((clock[4] or "0").ljust(6, "0")[:6]), tzinfo=UTC)
    except ValueError:
        return None
    return (when - EPOCH) / timedelta(seconds=1)


def _day(text: str) -> tuple[int, int, int] | None:
    """Year, month and day."""
    if found := YEAR_FIRST.search(text):
        return int(found[1]), int(found[2]), int(found[3])
    if found := DAY_FIRST.search(text):
        day, month = int(found[1]), int(found[2])
        return int(found[3]), *((month, day) if month <= 12 else (day, month))
    numbers = [int(number) for number in NUMBERS.findall(text)]
    month = next((number for word in reversed(WORDS.findall(text.lower())) if (number := _month(word))), 0)
    years, days = [n for n in numbers if n > 31], [n for n in numbers if n <= 31]
    return (years[0], month, days[0]) if month and years and days else None


def _month(word: str) -> int:
    return MONTH.get(word[:4]) or MONTH.get(word[:3]) or 0


def seconds_of_days(text: str) -> float | None:
    """PEAK's day number with a fraction as seconds since 1970, to the microsecond; None where it is none."""
    try:
        days = Decimal(text.strip().replace(",", "."))
        when = DAY_ZERO + timedelta(microseconds=int((days * 86_400_000_000).to_integral_value()))
    except (InvalidOperation, OverflowError, ValueError):
        return None
    return (when - EPOCH) / timedelta(seconds=1)
