"""What the reproduction shows of its networks: scenes, prior, maps along a drive, and curves."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import numpy as np
from PIL.Image import Image

from echogrid_training.learning.dataset import Samples, load_drive, of_detections, of_lidar, soft
from echogrid_training.learning.fit import some
from echogrid_training.learning.loss import CLASSES
from echogrid_training.paper.autoencoders import Autoencoder
from echogrid_training.paper.material import Part
from echogrid_training.paper.reproduction_pictures import chart, input_picture, map_picture, patch_picture, sheet
from echogrid_training.paper.reproduction_report import RULES, Reproduction
from echogrid_training.paper.table_one import table
from echogrid_training.paper.true_pose_map import Driven, MapErrors, Rule, driven, longest, map_errors, mapped, way_length
from echogrid_training.recording import Track
from echogrid_training.truth import ground_truth

SCENES = 2


def reproduction(networks: Sequence[Autoencoder], parts: Mapping[str, Part], track: Track) -> Reproduction:
    """Of trained networks: all that the page shows, drawn of the drives of the part 'test'; pictures are of the first seed's.

    Raises EchogridError.
    """
    lines, tested = table(networks), parts["test"].drives
    every, networks = networks, [one for one in networks if one.trained.settings.seed == networks[0].trained.settings.seed]
    drive = driven(longest(tested))
    errors, pictures = maps(networks, drive, track)
    scenes = [richest(load_drive(place, whole=True)) for place in some(tested, SCENES)]
    pictures |= {f"scene-{number}": scene(one, networks) for number, one in enumerate(scenes, 1)}
    pictures |= {"prior": prior(networks)} | curves(networks)
    encoded = {name: png(picture) for name, picture in pictures.items()}
    return Reproduction(every, lines, parts, drive.name, way_length(drive.way), errors, encoded)


def richest(samples: Samples) -> Samples:
    """The one with most occupied cells."""
    return samples.chosen(np.count_nonzero(samples.labels > 0, axis=(1, 2)).argmax(keepdims=True))


def scene(one: Samples, networks: Sequence[Autoencoder]) -> Image:
    """A row a sensor: what is shown, the two answers, the truth."""
    truth = ("truth", patch_picture(soft(one.labels)[0]))
    rows = []
    for sensor, image in (("lidar", of_lidar(one.lidar)), ("radar", of_detections(one.images))):
        answers = [_answer(network, one) for network in networks if network.sensor == sensor]
        rows.append([(f"{sensor}: what is shown", input_picture(image[0, 0])), *answers, truth])
    return sheet(rows)


def prior(networks: Sequence[Autoencoder]) -> Image:
    """What they answer where nothing was seen."""
    return sheet([[_answer(network, Samples.empty(1)) for network in networks]])


def _answer(network: Autoencoder, one: Samples) -> tuple[str, Image]:
    return network.title, patch_picture(ground_truth.soft(network.answers(one))[0])


def maps(networks: Sequence[Autoencoder], drive: Driven, track: Track) -> tuple[dict[tuple[Rule, str], MapErrors], dict[str, Image]]:
    """Errors and pictures of every network's map by each rule, and a picture of the true one."""
    truth = drive.truth
    errors: dict[tuple[Rule, str], MapErrors] = {}
    pictures = {"map-truth": map_picture(truth.log_odds, np.zeros_like(truth.log_odds), truth, drive.way)}
    for network in track(networks, f"mapping {drive.name}"):
        answers = network.answers(drive.samples)
        for rule in RULES:
            log_odds = mapped(answers, drive.poses, truth, rule)
            errors[rule, network.name] = map_errors(log_odds, truth.log_odds)
            pictures[f"map-{rule}-{network.name}"] = map_picture(log_odds, truth.log_odds, truth, drive.way)
    return errors, pictures


def curves(networks: Sequence[Autoencoder]) -> dict[str, Image]:
    """Of the logs: loss, and the held-out errors by class."""
    charts = {"curves-loss": chart("loss", {network.title: [line["loss"] for line in network.log] for network in networks})}
    for name in CLASSES:
        lines = {network.title: [line["held_out_mse"][name] for line in network.log] for network in networks}
        charts[f"curves-{name}"] = chart(f"held-out MSE, {name} cells", lines)
    return charts


def png(picture: Image) -> bytes:
    """The file."""
    file = io.BytesIO()
    picture.save(file, "PNG", optimize=True)
    return file.getvalue()
