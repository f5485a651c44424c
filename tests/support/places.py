"""Where things of the checkout lie."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
DBC, DEPLOY, DOCS = ROOT / "dbc", ROOT / "deploy", ROOT / "docs"
DEMO = ROOT / "service" / "echogrid" / "demo_drive"
