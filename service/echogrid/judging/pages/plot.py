"""Small plots as SVG text."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echogrid.core.messages import Floats

WIDTH, HEIGHT = 900, 260
LEFT, RIGHT, TOP, BOTTOM = 62, 12, 22, 36
COLOURS = ("#4c78a8", "#f58518", "#54a24b", "#b279a2", "#e45756", "#72b7b2")
LETTER = 8  # of a name, at most
MOST = 1500  # points of a curve


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """x and y (N,); dots, or a line."""

    name: str
    x: Floats
    y: Floats
    line: bool = False


def plot(curves: Sequence[Curve], x_unit: str, y_unit: str, *, equal: bool = False) -> str:
    """Curves over one pair of axes, lines beneath dots, coloured by their place in the list; those without a point are left out.

    `equal`: as large in x as in y. A sentence where there is nothing to draw.
    """
    coloured = [(COLOURS[n % len(COLOURS)], curve) for n, curve in enumerate(curves) if len(curve.x)]
    coloured.sort(key=lambda one: not one[1].line)
    curves, legend = [curve for _, curve in coloured], max(LEFT + 8, 20 + LETTER * len(y_unit))
    if not curves:
        return "<p>Nothing to draw.</p>"
    x_low, x_high = _limits([curve.x for curve in curves], trimmed=False)
    y_low, y_high = _limits([curve.y for curve in curves], trimmed=not equal)
    height = HEIGHT
    if equal:
        height = int(np.clip((WIDTH - LEFT - RIGHT) * (y_high - y_low) / (x_high - x_low), 120, 800)) + TOP + BOTTOM
        scale = max((x_high - x_low) / (WIDTH - LEFT - RIGHT), (y_high - y_low) / (height - TOP - BOTTOM))
        x_high, y_high = x_low + scale * (WIDTH - LEFT - RIGHT), y_low + scale * (height - TOP - BOTTOM)
    drawn = _axes(x_low, x_high, y_low, y_high, height, x_unit, y_unit)
    for colour, curve in coloured:
        every = max(1, len(curve.x) // MOST) if not equal or curve.line else 1
        x = LEFT + (curve.x[::every] - x_low) / (x_high - x_low) * (WIDTH - LEFT - RIGHT)
        y = height - BOTTOM - (np.clip(curve.y[::every], y_low, y_high) - y_low) / (y_high - y_low) * (height - TOP - BOTTOM)
        if curve.line:
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
            drawn.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        else:
            dots = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x, y, strict=True))
            drawn.append(f'<path d="{dots}" stroke="{colour}" stroke-width="2.2" stroke-linecap="round" opacity="0.6"/>')
        if curve.name:
            drawn.append(f'<text x="{legend}" y="14" fill="{colour}">{html.escape(curve.name)}</text>')
            legend += 40 + LETTER * len(curve.name)
    return _svg(drawn, height)


def bars(edges: Floats, counts: Floats, x_unit: str, y_unit: str) -> str:
    """A histogram: edges (B + 1,), counts (B,)."""
    high = float(max(counts.max(), 1.0))
    drawn = _axes(float(edges[0]), float(edges[-1]), 0.0, high, HEIGHT, x_unit, y_unit)
    across = (WIDTH - LEFT - RIGHT) / (edges[-1] - edges[0])
    for low, up, count in zip(edges[:-1], edges[1:], counts, strict=True):
        tall = count / high * (HEIGHT - TOP - BOTTOM)
        x, width = LEFT + (low - edges[0]) * across, (up - low) * across - 1
        drawn.append(f'<rect x="{x:.1f}" y="{HEIGHT - BOTTOM - tall:.1f}" width="{width:.1f}" height="{tall:.1f}" fill="{COLOURS[0]}"/>')
    return _svg(drawn, HEIGHT)


def _svg(drawn: Sequence[str], height: int) -> str:
    style = 'font-size="12" font-family="system-ui, sans-serif" fill="currentColor"'
    return f'<svg viewBox="0 0 {WIDTH} {height}" role="img" {style}>' + "".join(drawn) + "</svg>"


def _limits(values: Sequence[Floats], *, trimmed: bool) -> tuple[float, float]:
    """What holds all, or nearly all where `trimmed`, and is not empty."""
    joined = np.concatenate(values)
    joined = joined[np.isfinite(joined)]
    if not len(joined):
        return 0.0, 1.0
    low, high = np.percentile(joined, (0.2, 99.8)) if trimmed else (joined.min(), joined.max())
    margin = max(0.05 * (high - low), 1e-3)
    return float(low - margin), float(high + margin)


def _axes(x_low: float, x_high: float, y_low: float, y_high: float, height: int, x_unit: str, y_unit: str) -> list[str]:
    drawn = []
    for value in _ticks(x_low, x_high):
        x = LEFT + (value - x_low) / (x_high - x_low) * (WIDTH - LEFT - RIGHT)
        drawn.append(f'<path d="M{x:.1f} {TOP}V{height - BOTTOM}" stroke="currentColor" opacity="0.15"/>')
        drawn.append(f'<text x="{x:.1f}" y="{height - BOTTOM + 15}" text-anchor="middle">{value:g}</text>')
    for value in _ticks(y_low, y_high):
        y = height - BOTTOM - (value - y_low) / (y_high - y_low) * (height - TOP - BOTTOM)
        drawn.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="currentColor" opacity="0.15"/>')
        drawn.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
    drawn.append(f'<text x="{WIDTH - RIGHT}" y="{height - 6}" text-anchor="end">{html.escape(x_unit)}</text>')
    drawn.append(f'<text x="4" y="14">{html.escape(y_unit)}</text>')
    return drawn


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers, about six; none of them is -0."""
    rough = (high - low) / 6
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(power * min((1, 2, 5, 10), key=lambda one: abs(one * power - rough)))
    return [round(float(value), 10) + 0.0 for value in np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step]
