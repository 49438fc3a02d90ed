"""Sensors: the true motion of a plan becomes what the registers and stamps of a bench would say."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy import signal

from sinew.measure.arrays import Array
from sinew.mechanics.drive import motor_current
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.tendons import tendon_tension
from sinew.plan.rig import Bus, Imu, RigSpec
from sinew.plan.servo import SERVOS, VOLTAGE_LSB
from sinew.twin.parameters import Effects


class Moved(NamedTuple):
    """The true motion of a plan's groups, one after the other; arrays (sample, ...), SI.

    counts: samples of each group (group,). torsion: of the head. lever, lever_rate, duty: of the drive. stretch:
    elongation of each tendon; driven: what its motor was told to take up since the start; at_rest: what it had taken
    up then, at first contact nothing (group, tendon); all [m]. gyro, gyro_rate: angular velocity of the head in its
    axes behind the gyroscope's low-pass, and its derivative, spin: before it; force: specific force at the chip, in
    those axes. orientation: of the head, (sample, 4), where it does more than turn.
    """

    counts: NDArray[np.intp]
    torsion: Array
    lever: Array
    lever_rate: Array
    duty: Array
    stretch: Array
    driven: Array
    at_rest: Array
    gyro: Array
    gyro_rate: Array
    spin: Array
    force: Array
    orientation: Array | None

    @property
    def starts(self) -> NDArray[np.intp]:
        """Return the first sample of every group."""
        return np.concatenate([[0], np.cumsum(self.counts)[:-1]])


def _noise(std: float, imu: Imu, size: int, sample_hz: float, rng: np.random.Generator) -> Array:
    """Return noise of a standard deviation, coloured by the sensor's own low-pass."""
    white = rng.standard_normal(size)
    corner = imu.low_pass.value
    if corner >= 0.45 * sample_hz:
        return std * white
    b, a = signal.butter(2, corner, fs=sample_hz)
    _, h = signal.freqz(b, a, worN=512)
    return np.asarray(std / np.sqrt(np.mean(np.abs(h) ** 2)) * signal.lfilter(b, a, white))


def _moving_average(values: Array, starts: NDArray[np.intp], count: int) -> Array:
    """Return the causal mean over `count` samples; before the start of a group the first sample is repeated."""
    index = np.arange(values.size)
    first = np.zeros(values.size, dtype=np.intp)
    first[starts] = starts
    first = np.maximum.accumulate(first)
    total = np.zeros_like(values)
    for back in range(count):
        total += values[np.maximum(index - back, first)]
    return total / count


def read_rounded(values: Array, lsb: float, effects: Effects) -> Array:
    """Return values rounded to a register's unit."""
    return np.round(values / lsb) * lsb if effects.sensor_noise else values


def read_gyro(
    low_passed: Array,
    low_passed_rate: Array,
    true_rate: Array,
    starts: NDArray[np.intp],
    sample_hz: float,
    imu: Imu,
    effects: Effects,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Return the gyroscope's three axes as the stock OpenCR library reports them [rad/s], shape (sample, 3).

    low_passed, low_passed_rate: angular velocity of the head, in its axes, behind the chip's low-pass and its
    derivative, (sample, 3). true_rate: before it. starts: first sample of every group.
    Range, noise, bias, residual delay (first order in τ: its remainder is (Ωτ)²/2 = 6e-5 at 4.3 Hz), moving
    average, whole LSB, dead band.
    """
    readings = np.zeros(true_rate.shape, dtype=np.float32)
    late = low_passed - imu.residual_delay.value * low_passed_rate if effects.sensor_filter else true_rate
    for axis in range(3):
        values = late[:, axis]
        if effects.sensor_noise:
            bias = imu.gyro_bias.value * rng.standard_normal()
            values = values + bias + _noise(imu.gyro_noise.value, imu, values.size, sample_hz, rng)
            values = np.clip(values, -imu.gyro_range.value, imu.gyro_range.value)
        if effects.sensor_filter:
            values = _moving_average(values, starts, imu.average_samples)
        if effects.sensor_noise:
            raw = np.round(values / imu.gyro_lsb.value)
            values = np.where(np.abs(raw) <= imu.dead_band, 0.0, raw) * imu.gyro_lsb.value
        readings[:, axis] = values
    return readings


def read_accelerometer(force: Array, imu: Imu, effects: Effects, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return the accelerometer's three axes [m/s²], shape (sample, 3), for the specific force at the chip, of that
    shape, in frame H; clipped at the range. Its low-pass is not modelled."""
    if effects.sensor_noise:
        force = force + imu.accelerometer_noise.value * rng.standard_normal(force.shape)
        force = np.clip(force, -imu.accelerometer_range.value, imu.accelerometer_range.value)
        force = np.round(force / imu.accelerometer_lsb.value) * imu.accelerometer_lsb.value
    return force.astype(np.float32)


def stamp(counts: NDArray[np.intp], sample_hz: float, bus: Bus, effects: Effects, rng: np.random.Generator) -> Array:
    """Return the host's time stamps [s] of groups that follow one another, shape (sum of counts,).

    Jitter is normal, cut at 0.4 sample intervals so that stamps keep their order.
    """
    index = np.arange(int(counts.sum()))
    ideal = index / sample_hz
    if not effects.stamp_jitter:
        return ideal
    jitter = bus.stamp_jitter.value * rng.standard_normal(index.size)
    return np.asarray(ideal + np.clip(jitter, -0.4 / sample_hz, 0.4 / sample_hz))


_READ = (
    "amplitude", "omega", "stop_s", "duty_torque", "speed_slope", "torque_constant", "stiffness", "held_tension", "mode"
)  # fmt: skip
"""Parameters that the registers' readings depend on."""


def read_sensors(
    moved: Moved, p: Parameters, sample_hz: float, rig: RigSpec, effects: Effects, rng: np.random.Generator
) -> dict[str, NDArray[Any]]:
    """Return every channel of the recording over all groups, one after the other. p: parameters of each (group)."""
    counts, starts = moved.counts, moved.starts
    # tendons that are set one by one have their axis first, as what is elementwise over samples wants it
    repeated: dict[str, Any] = {n: jnp.asarray(np.repeat(np.asarray(getattr(p, n)), counts, axis=0).T) for n in _READ}
    each = p._replace(**repeated)
    own_time = (np.arange(counts.sum()) - np.repeat(starts, counts)) / sample_hz
    command = np.where(own_time < each.stop_s, each.amplitude * np.sin(each.omega * own_time), 0.0)

    drive, bus, tendons = rig.drive, rig.bus, rig.tendons
    late = bus.drive_delay.value if effects.sensor_filter else 0.0
    lever = moved.lever - late * moved.lever_rate
    current = np.asarray(motor_current(jnp.asarray(moved.duty), jnp.asarray(moved.lever_rate), each))
    tension = np.asarray(tendon_tension(jnp.asarray(moved.stretch.T), each)).T
    taken_up = _take_up(moved, tension, rig) / tendons.pulley_radius.value
    pull = tendons.current(tension)
    supply = np.full(command.size, drive.supply_voltage.value)
    turn = 2 * np.pi
    channels: dict[str, NDArray[Any]] = {
        "time_s": stamp(counts, sample_hz, bus, effects, rng),
        "drive_command_rad": command.astype(np.float32),
        "drive_rad": read_rounded(lever, turn / drive.counts_per_turn.value, effects).astype(np.float32),
        "drive_current_a": read_rounded(current, drive.current_lsb.value, effects).astype(np.float32),
        "drive_pwm": read_rounded(moved.duty, drive.duty_lsb.value, effects).astype(np.float32),
        "tendon_rad": read_rounded(taken_up, turn / tendons.counts_per_turn.value, effects).astype(np.float32),
        "tendon_current_a": read_rounded(pull, tendons.current_lsb.value, effects).astype(np.float32),
        "tendon_pwm": read_rounded(
            _tendon_duty(pull, taken_up, starts, sample_hz, rig), drive.duty_lsb.value, effects
        ).astype(np.float32),
        "supply_v": read_rounded(supply, VOLTAGE_LSB, effects).astype(np.float32),
        "gyro_rad_s": read_gyro(moved.gyro, moved.gyro_rate, moved.spin, starts, sample_hz, rig.imu, effects, rng),
        "acceleration_m_s2": read_accelerometer(moved.force, rig.imu, effects, rng),
    }
    if moved.orientation is not None:
        channels["orientation"] = moved.orientation.astype(np.float32)
    noise = rng if effects.sensor_noise else None
    return channels | {s.channel: s.told(tension, noise).astype(np.float32) for s in rig.sensors}


def _tendon_duty(
    current: NDArray[np.float64], angle: NDArray[np.float64], starts: NDArray[np.intp], sample_hz: float, rig: RigSpec
) -> NDArray[np.float64]:
    """Return the duty of the tendon motors, (sample, tendon), for their current [A] and angle [rad] of that shape.

    (R i + k_e ω)/V: what holds the current against winding and back-EMF. R and k_e of the model's data sheet: nominal
    voltage over stall current, and over no-load speed.
    """
    servo = SERVOS[rig.wiring.tendon_model]
    supply = rig.drive.supply_voltage.value
    duty = (servo.resistance / supply) * current
    turned = angle[2:] - angle[:-2]
    inside = np.ones(angle.shape[0], dtype=bool)  # a group's first and last sample have no neighbour on one side
    inside[starts] = inside[starts - 1] = False
    duty[1:-1] += (servo.nominal_voltage / servo.no_load_speed / supply * 0.5 * sample_hz) * turned * inside[1:-1, None]
    return np.asarray(np.clip(duty, -1.0, 1.0))


def _take_up(moved: Moved, tension: NDArray[np.float64], rig: RigSpec) -> NDArray[np.float64]:
    """Return how much cable the motors have taken up since first contact [m], shape (sample, tendon).

    A group starts at rest with its pretension taken up, less what the servo gives way under the added tension;
    then the motor follows its command, length and tension: Δw = -Δℓ + ΔT/k_cable.
    """
    cable, servo = rig.tendons.cable_stiffness.value, rig.tendons.servo_stiffness.value
    contact = rig.tendons.first_contact_tension.value
    rest = np.repeat(moved.starts, moved.counts)
    followed = -(moved.stretch - moved.stretch[rest]) + (tension - tension[rest]) / cable
    at_rest = np.repeat(moved.at_rest, moved.counts, axis=0)
    return np.asarray(at_rest - (tension[rest] - contact) / servo + followed + moved.driven)
