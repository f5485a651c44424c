"""Our radar's DBC as many write theirs: detections numbered through the pages of a multiplexor."""

from __future__ import annotations

import re

from tests.support.places import DBC

SIGNAL = re.compile(r" SG_ (Range|Azimuth|RangeRate|Rcs|Quality|Valid)_(\d) : (.*)")


def paged_dbc(pages: int) -> str:
    """Eight detections on each page: the same bits as in corner_radar.dbc."""
    lines = []
    for line in (DBC / "corner_radar.dbc").read_text().splitlines():
        if (found := SIGNAL.match(line)) is None:
            lines.append(line.replace("SG_ Page :", "SG_ Page M :"))
        else:
            lines += [f" SG_ {found[1]}_{int(found[2]) + 8 * page} m{page} : {found[3]}" for page in range(pages)]
    return "\n".join(lines) + "\n"
