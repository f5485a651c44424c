"""Curves over one axis as an SVG picture: several panels, one below the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

WIDTH, HEIGHT, LEFT, RIGHT, TOP = 760, 130, 70, 20, 26


@dataclass(frozen=True, slots=True)
class Curve:
    """One panel. `lowest`: what the axis begins with; None: the smallest value. `over`: an x of its own."""

    title: str
    values: Sequence[float]
    lowest: float | None = 0.0
    over: Sequence[float] = ()


def chart(x: Sequence[float], label: str, curves: Sequence[Curve]) -> str:
    """SVG text; x and the values of every curve without an x of its own are equally long."""
    height = len(curves) * (HEIGHT + TOP) + 40
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{height}" fill="white"/>',
    ]
    for index, curve in enumerate(curves):
        parts += _panel(x, curve, index * (HEIGHT + TOP) + TOP)
    bottom = len(curves) * (HEIGHT + TOP) + 14
    parts += _ends(x, bottom) if x else []
    parts.append(f'<text x="{(LEFT + WIDTH) / 2}" y="{bottom}" text-anchor="middle">{escape(label)}</text></svg>')
    return "\n".join(parts)


def _ends(x: Sequence[float], bottom: float) -> list[str]:
    return [
        f'<text x="{LEFT}" y="{bottom}">{x[0]:g}</text>',
        f'<text x="{WIDTH - RIGHT}" y="{bottom}" text-anchor="end">{x[-1]:g}</text>',
    ]


def _panel(x: Sequence[float], curve: Curve, top: float) -> list[str]:
    x = curve.over or x
    low = min(curve.values) if curve.lowest is None else curve.lowest
    high = max(curve.values) * 1.05
    if high <= low:
        high = low + 1.0
    span = max(x[-1] - x[0], 1e-9)
    inner = HEIGHT - 14
    points = " ".join(
        f"{LEFT + (WIDTH - LEFT - RIGHT) * (at - x[0]) / span:.1f},{top + inner - inner * (value - low) / (high - low):.1f}"
        for at, value in zip(x, curve.values, strict=True)
    )
    return [
        f'<text x="{LEFT}" y="{top - 6}" font-weight="bold">{escape(curve.title)}</text>',
        f'<rect x="{LEFT}" y="{top}" width="{WIDTH - LEFT - RIGHT}" height="{inner}" fill="none" stroke="#bbb"/>',
        f'<text x="{LEFT - 6}" y="{top + 10}" text-anchor="end">{high:.4g}</text>',
        f'<text x="{LEFT - 6}" y="{top + inner}" text-anchor="end">{low:.4g}</text>',
        f'<polyline points="{points}" fill="none" stroke="#1f5fa8" stroke-width="1.5"/>',
        *(_ends(x, top + inner + 12) if curve.over else []),
    ]
