"""The reproduction as one HTML page with its pictures inside, and its figures for programs."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import Any

from echogrid_training.learning.autoencoder import weight_count
from echogrid_training.paper import table_one
from echogrid_training.paper.autoencoders import Autoencoder
from echogrid_training.paper.material import Part, described
from echogrid_training.paper.table_one import SCHEMES, Line
from echogrid_training.paper.true_pose_map import CLAMP, MapErrors, Rule

RULES: Mapping[Rule, str] = {
    "endless": "sum of the log-odds, the paper's Eq. (1)",
    "sum": f"the same within ±{CLAMP}, as the service sums",
    "looks": "mean of the looks",
}

STYLE = """
body { max-width: 1120px; margin: 2em auto; padding: 0 1em; font: 16px/1.5 sans-serif; color: #282c34; background: #fff; }
h1, h2 { line-height: 1.2; font-weight: 600; }
h2 { margin-top: 2em; border-bottom: 1px solid #d7dbe1; }
table { border-collapse: collapse; margin: 1em 0; display: block; max-width: 100%; overflow-x: auto; }
th, td { padding: .25em .7em; border-bottom: 1px solid #d7dbe1; text-align: left; vertical-align: top; }
th.number, td.number { text-align: right; font-variant-numeric: tabular-nums; }
figure { margin: 1em 0; }
figure img { max-width: 100%; height: auto; }
figcaption { color: #565c66; font-size: 14px; }
.pair, .three { display: grid; grid-template-columns: 1fr 1fr; gap: 1em; }
.three { grid-template-columns: 1fr 1fr 1fr; }
.pair figure, .three figure { margin: 0; }
code { font-size: 14px; overflow-wrap: anywhere; }
"""


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """All that the page says. Pictures are PNG by name: scene-1, scene-2, …, prior, curves-…, map-truth, map-RULE-NETWORK."""

    networks: Sequence[Autoencoder]
    table: Sequence[Line]
    parts: Mapping[str, Part]  # 'learned from', 'validation' and 'test'
    drive: str  # of the maps
    way: float  # m
    maps: Mapping[tuple[Rule, str], MapErrors]  # by rule and name of the network, of the first seed's
    pictures: Mapping[str, bytes]


def page(made: Reproduction) -> str:
    """The whole page; it needs no other file."""
    body = "\n".join((_opening(made), _table(made), _scenes(made), _prior(made), _maps(made), _curves(made), _settings(made)))
    title = "Deep, spatially coherent occupancy maps: a reproduction on simulated drives"
    return f"""<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style></head>
<body>
<h1>{title}</h1>
{body}
</body>
</html>
"""


def _opening(made: Reproduction) -> str:
    trained = made.networks[0].trained
    return f"""<p>D. Bauer, L. Kuhnert and L. Eckstein, <i>Deep, spatially coherent Occupancy Maps based on Radar Measurements</i>
(arXiv 1903.12467), train four autoencoders that turn one image of sensor returns into log-odds of occupancy for the 128 x 128 cells
around a car: from a lidar or from four radars, with two ways to weight the classes. This page repeats their table and figures; its
pictures are beside it as PNG files too.</p>
<p><b>What is not the paper's.</b> The figure with the network is not in the paper's text, so we chose channel widths, depth and
kernels: five convolutions of kernel 4 and stride 2 down to 4 x 4 cells, five deconvolutions back, one convolution of kernel 3, with
LeakyReLU and batch norm; width {trained.settings.width}, {weight_count(trained.model()) / 1e6:.2f} million weights. Optimiser, rate and
strength of L2 are ours too. <b>The towns are simulated</b>: streets, traffic, radars, lidar and motion sensors are generated, since the
paper's recordings are not public. So compare the pattern of the numbers with the paper's, not the scores.</p>"""


def _table(made: Reproduction) -> str:
    seeds = made.table[0].seeds
    spread = f"Means of {seeds} seeds ± their standard deviation; " if seeds > 1 else "One seed; "
    return f"""<h2>Table I: mean squared error by class</h2>
{_rows(table_one.rows(made.table), table_one.HEAD)}
<p>Of tanh(log-odds / 2), pooled over all pixels of the test towns. <i>Free</i>, <i>unknown</i>, <i>occupied</i>: against labels -1, 0 and
1, as the paper writes its classes. <i>Soft</i>: against labels tanh(L / 2) of the true log-odds L, in classes by their sign. {spread}in
brackets the middle 95 % of 1,000 draws of the test towns, which say nothing about other seeds. For
comparison: a network that says <i>unknown</i> everywhere has 1, 0 and 1, one that says <i>free</i> everywhere 0, 1 and 4.</p>
{_rows(table_one.told(table_one.observations(made.table)), ("what the table shows in the paper", "here too"))}"""


def _scenes(made: Reproduction) -> str:
    names = [name for name in made.pictures if name.startswith("scene-")]
    figures = "\n".join(_figure(made, name, f"Scene {number}.") for number, name in enumerate(names, 1))
    return f"""<h2>The inverse sensor models (the paper's Fig. 5)</h2>
<p>In the paper's colours: free black, unknown grey, occupied white. Ahead is up; the car's outline is green. The input of a network
has a white dot in every cell with a return, here enlarged to 3 x 3 cells. The scenes were chosen without any network:
from drives spread evenly over the test set, the sample with the most occupied cells.</p>
{figures}"""


def _prior(made: Reproduction) -> str:
    return f"""<h2>The learned spatial prior (Fig. 6)</h2>
<p>The paper shows its prior by what the lidar network with independent class MSE adds to what was seen: input, answer and truth, as in the
upper rows above. The prior alone is what a network answers to an image in which nothing was seen at all.</p>
{_figure(made, "prior", "Answers to an empty image.")}"""


def _drawn(made: Reproduction) -> list[Autoencoder]:
    """Those that maps were made of."""
    return [network for network in made.networks if ("sum", network.name) in made.maps]


def _maps(made: Reproduction) -> str:
    errors = []
    for network in _drawn(made):
        for rule, title in RULES.items():
            of = made.maps[rule, network.name]
            shares = [_share(of.sure), _share(of.sure_and_wrong)]
            errors.append([network.sensor, SCHEMES[network.weighting], title, *shares, _number(of.bits), _number(of.fitted_bits)])
    head = ("sensor", "class weights", "rule", "sure cells", "wrong of those", "bits per cell", "after a fit")
    figures = "\n".join(_map_row(made, network) for network in _drawn(made))
    return f"""<h2>Large-scale mapping (Fig. 7)</h2>
<p>The answers along {escape(made.drive)}, with {made.way:.0f} m the longest test drive, combined at the true poses. Over each map, in
orange, the occupied cells of the true map, and in blue the driven path. Left by the paper's Eq. (1), which adds the log-odds
of every update; in the middle the same, kept within ±{CLAMP} as in the service; right by the rule <code>looks</code>, the mean over
the same updates.</p>
<p>Eq. (1) treats the answers as independent. They are not: much of an answer is the prior, and every update repeats it. Added some
dozens of times it makes nearly every cell sure, whether it is right or wrong; their order it keeps for the most part. The clamp loses the
order as well: what was said last decides. The mean counts the prior once. The table shows how much that is.</p>
{_rows(errors, head)}
<p>Over the cells that both the map and the truth know. Sure: log-odds of {CLAMP} or more by amount, p below 0.03 or above 0.97.
Bits per cell: what it costs to encode the truth when the map's probability is known; a map that says the share of occupied cells
everywhere needs {_number(next(iter(made.maps.values())).least)}. After a fit: with the best two numbers in a · log-odds + b for each map,
since the class weights shift the odds.</p>
{_figure(made, "map-truth", "The true map: what an ideal lidar says along the path, summed by Eq. (1).")}
{figures}"""


def _map_row(made: Reproduction, network: Autoencoder) -> str:
    scheme = SCHEMES[network.weighting]
    figures = [_figure(made, f"map-{rule}-{network.name}", f"{network.sensor}, {scheme}: {title}.") for rule, title in RULES.items()]
    return f'<div class="three">{"".join(figures)}</div>'


def _curves(made: Reproduction) -> str:
    charts = "".join(_figure(made, name) for name in made.pictures if name.startswith("curves-"))
    return f"""<h2>Convergence</h2>
<p>The training loss, whose scale differs between the weightings, and the errors in held-out towns after each epoch, as in
the networks' <code>log.jsonl</code>.</p>
<div class="pair">{charts}</div>"""


def _settings(made: Reproduction) -> str:
    parts = [
        (name, str(len(part.drives)), str(part.samples), " ".join(part.plans) or "not noted", part.sha256)
        for name, part in made.parts.items()
    ]
    names = [(name, ", ".join(drive.name for drive in part.drives)) for name, part in made.parts.items()]
    first = made.networks[0].trained
    same = [(key, str(value)) for key, value in asdict(first.settings).items() if key not in ("sensor", "weighting", "seed")]
    runs = [
        (
            network.sensor,
            SCHEMES[network.weighting],
            str(network.trained.settings.seed),
            str(network.log[-1]["step"]),
            f"{sum(line['seconds'] for line in network.log) / 60:.1f}",
            network.sha256,
        )
        for network in made.networks
    ]
    return f"""<h2>Settings</h2>
{_rows(parts, ("drives", "how many", "samples", "plan of their campaign", "sha256 of the samples"))}
{_rows(names, ("drives", "names"))}
<p>Samples are at least 1 m apart, and none is disturbed. A sample's lidar turn is the newest at that time, at most 0.1 s old. Labels are
the whole true patch. Shares of free, unknown and occupied cells in what was learned from:
{", ".join(_number(share) for share in first.shares)}.</p>
{_rows(same, ("setting", "of all"))}
{_rows(runs, ("sensor", "class weights", "seed", "steps", "minutes", "sha256 of model.pt"))}"""


def figures(made: Reproduction) -> dict[str, Any]:
    """All of the page's numbers, as JSON knows them."""
    maps = {
        f"{name}, {rule}": {key: None if math.isnan(value) else value for key, value in asdict(errors).items()}
        for (rule, name), errors in made.maps.items()
    }
    return {
        "table": table_one.figures(made.table),
        "observations": [{"claim": claim, "holds": holds, "draws": share} for claim, holds, share in table_one.observations(made.table)],
        "settings": asdict(made.networks[0].trained.settings),
        "networks": {network.name: {"sha256": network.sha256, "log": network.log} for network in made.networks},
        "parts": described(made.parts),
        "maps": {"drive": made.drive, "way": made.way} | maps,
    }


def _rows(rows: Iterable[Sequence[str]], head: Sequence[str]) -> str:
    """A table; columns that start with a number are aligned right."""
    rows = list(rows)
    kinds = [" class=number" if _is_number(cell) else "" for cell in rows[0]]

    def line(tag: str, cells: Sequence[str]) -> str:
        return f"<tr>{''.join(f'<{tag}{kind}>{escape(cell)}</{tag}>' for kind, cell in zip(kinds, cells, strict=True))}</tr>"

    return "\n".join(("<table>", line("th", head), *(line("td", row) for row in rows), "</table>"))


def _figure(made: Reproduction, name: str, caption: str = "") -> str:
    inside = base64.b64encode(made.pictures[name]).decode()
    return f"""<figure><img alt="{escape(name)}" src="data:image/png;base64,{inside}">
<figcaption>{escape(caption)}</figcaption></figure>"""


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.3f}"


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.1%}"


def _is_number(cell: str) -> bool:
    return cell == "–" or cell.removesuffix("%").replace(".", "", 1).isdecimal()
