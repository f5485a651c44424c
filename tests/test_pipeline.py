"""What a configuration says reaches those whom it is said to."""

from __future__ import annotations

from pathlib import Path

import pytest

from echogrid.config.loading import load_config
from echogrid.pipeline import Pipeline
from tests.support.places import DEMO


@pytest.mark.parametrize("learns", ["driving", "standing", "never"])
def test_what_may_be_learned_of_the_motion_sensors_is_as_configured(tmp_path: Path, learns: str) -> None:
    path, text = tmp_path / "car.toml", (DEMO / "echogrid.toml").read_text()
    path.write_text('model = "analytic"\n' + text.replace("[motion]\n", f'[motion]\nlearns = "{learns}"\n'))
    pipeline = Pipeline(load_config(path), path)
    assert pipeline.mapper.odometry.errors.learns == learns
    assert pipeline.mapper.odometry.errors.radars == tuple(pipeline.mapper.mounts)
