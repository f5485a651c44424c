"""Wheel speeds and yaw rate as the car's sensors report them."""

from __future__ import annotations

import numpy as np

from echogrid.core.messages import Floats
from echogrid_training.recording import EPOCH_NS, Motion
from echogrid_training.sensors.episode import MotionErrors
from echogrid_training.towns.town import Track
from echogrid_training.worlds.scene import wheel_speeds


def sense_motion(ego: Track, errors: MotionErrors, rng: np.random.Generator) -> Motion:
    """What the sensors report along the ego's track, stamped EPOCH_NS later than its times."""
    times = np.arange(ego.time[0], ego.time[-1], errors.period)
    stamp_ns = EPOCH_NS + np.round(times * 1e9).astype(np.int64)
    return Motion(stamp_ns, wheels(ego, times, errors, rng), stamp_ns, yaw_rates(ego, times, errors, rng))


def wheels(ego: Track, times: Floats, errors: MotionErrors, rng: np.random.Generator) -> Floats:
    """(N, 4) m/s at the times (N,) s: rear left, rear right, front left, front right; negative in reverse."""
    shown = times - errors.wheel_latency
    speed, yaw_rate = np.interp(shown, ego.time, ego.speed), np.interp(shown, ego.time, ego.yaw_rate)
    true = wheel_speeds(np.abs(speed), yaw_rate * np.where(speed < 0, -1.0, 1.0)) * np.where(speed < 0, -1.0, 1.0)[:, None]
    acceleration = np.interp(shown, ego.time, np.gradient(ego.speed, ego.time)) * np.where(speed < 0, -1.0, 1.0)
    scale = errors.wheel_scale * (1.0 + np.array(errors.wheel_uneven)) * (1.0 + errors.slip * acceleration[:, None])
    turning = np.abs(true) > max(errors.standstill, 1e-3)  # standing wheels make no noise
    noisy = true * scale + rng.normal(0.0, errors.wheel_sigma, true.shape)
    return np.where(turning, quantised(noisy, errors.wheel_step), 0.0)


def yaw_rates(ego: Track, times: Floats, errors: MotionErrors, rng: np.random.Generator) -> Floats:
    """(N,) rad/s at the times (N,) s, counter-clockwise positive."""
    true = np.interp(times - errors.yaw_latency, ego.time, ego.yaw_rate)
    return quantised(true * errors.yaw_scale + errors.yaw_bias + rng.normal(0.0, errors.yaw_sigma, len(times)), errors.yaw_step)


def quantised(values: Floats, step: float) -> Floats:
    """Rounded to multiples of `step`; as they are where it is 0."""
    return np.round(values / step) * step if step > 0 else values
