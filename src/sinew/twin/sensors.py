"""Sensors: the true motion of a plan becomes what the registers and stamps of a bench would say."""

from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray
from scipy import signal

from sinew.measure.arrays import Array
from sinew.mechanics.drive import motor_current
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.tendons import tendon_tension
from sinew.plan.rig import Bus, Imu, RigSpec
from sinew.plan.servo import SERVOS, VOLTAGE_LSB
from sinew.solve.programs import program
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


_BLOCK = 1 << 15
"""Samples that are read together: what they need stays in the processor's cache."""


def _noise(std: float, imu: Imu, size: int, sample_hz: float, rng: np.random.Generator) -> Array:
    """Return noise of a standard deviation, coloured by the sensor's own low-pass: Butterworth's, of second order."""
    white = rng.standard_normal(size)
    corner = imu.low_pass.value
    if corner >= 0.45 * sample_hz:
        return std * white
    b, a = signal.butter(2, corner, fs=sample_hz)
    _, response = signal.freqz(b, a, 512)
    noise: Array = signal.lfilter(b, a, white)
    return noise * (std / float(np.sqrt(np.mean(np.abs(response) ** 2))))


def _moving_average(values: Array, starts: NDArray[np.intp], count: int) -> Array:
    """Return the causal mean over `count` samples; before the start of a group the first sample is repeated."""
    total = values.copy()
    for back in range(1, count):
        total[back:] += values[:-back]
    index = starts[:, None] + np.arange(count - 1)
    own = index < np.append(starts[1:], values.size)[:, None]
    early, first = index[own], np.broadcast_to(starts[:, None], index.shape)[own]
    total[early] = values[early]
    for back in range(1, count):
        total[early] += values[np.maximum(early - back, first)]
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
    for axis in range(3):
        values = true_rate[:, axis]
        if effects.sensor_filter:
            values = low_passed[:, axis] - imu.residual_delay.value * low_passed_rate[:, axis]
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
    if not effects.sensor_noise:
        return force.astype(np.float32)
    read = rng.standard_normal(force.shape)  # one array, for it is a large one
    read *= imu.accelerometer_noise.value
    read += force
    np.clip(read, -imu.accelerometer_range.value, imu.accelerometer_range.value, out=read)
    read /= imu.accelerometer_lsb.value
    np.round(read, out=read)
    read *= imu.accelerometer_lsb.value
    return read.astype(np.float32)


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


_OF_TENSION = ("stiffness", "held_tension", "mode")
"""Parameters that a tendon's tension depends on."""


@program()
def _tension(stretch: jax.Array, held: dict[str, Any], p: Parameters) -> jax.Array:
    return tendon_tension(stretch, p._replace(**held))


def _tensions(stretch: Array, p: Parameters, group: NDArray[np.intp]) -> Array:
    """Return the tension of every tendon [N] for its elongation [m], (sample, tendon); group: of each sample.

    In blocks of one size, so that it is compiled once.
    """
    held = {name: np.asarray(getattr(p, name)) for name in _OF_TENSION}
    one = jax.tree.map(lambda leaf: np.asarray(leaf)[0], p)  # of whatever else a group has, nothing is asked
    tension = np.empty(stretch.shape)
    for begin in range(0, len(group), _BLOCK):
        block = group[begin : begin + _BLOCK]
        padded = np.pad(block, (0, _BLOCK - block.size), mode="edge")
        lengths = np.pad(stretch[begin : begin + _BLOCK], ((0, padded.size - block.size), (0, 0)), mode="edge")
        # tendons that are set one by one have their axis first, as what is elementwise over samples wants it
        found = _tension(lengths.T, {name: values[padded].T for name, values in held.items()}, one)
        tension[begin : begin + block.size] = np.asarray(found).T[: block.size]
    return tension


def read_sensors(
    moved: Moved, p: Parameters, sample_hz: float, rig: RigSpec, effects: Effects, rng: np.random.Generator
) -> dict[str, NDArray[Any]]:
    """Return every channel of the recording over all groups, one after the other. p: parameters of each (group)."""
    counts, starts = moved.counts, moved.starts
    group = np.repeat(np.arange(counts.size), counts)
    tension = _tensions(moved.stretch, p, group)
    supply = np.full(group.size, rig.drive.supply_voltage.value)
    channels: dict[str, NDArray[Any]] = {"time_s": stamp(counts, sample_hz, rig.bus, effects, rng)}
    channels |= _read_motors(moved, p, group, tension, sample_hz, rig, effects)
    channels |= {
        "supply_v": read_rounded(supply, VOLTAGE_LSB, effects).astype(np.float32),
        "gyro_rad_s": read_gyro(moved.gyro, moved.gyro_rate, moved.spin, starts, sample_hz, rig.imu, effects, rng),
        "acceleration_m_s2": read_accelerometer(moved.force, rig.imu, effects, rng),
    }
    if moved.orientation is not None:
        channels["orientation"] = moved.orientation.astype(np.float32)
    noise = rng if effects.sensor_noise else None
    return channels | {s.channel: s.reading(tension, noise).astype(np.float32) for s in rig.sensors}


def _read_motors(
    moved: Moved,
    p: Parameters,
    group: NDArray[np.intp],
    tension: Array,
    sample_hz: float,
    rig: RigSpec,
    effects: Effects,
) -> dict[str, NDArray[np.float32]]:
    """Return what the registers of the drive and of the tendon motors say; tension: of each tendon (sample, tendon)."""
    drive, tendons, starts, size = rig.drive, rig.tendons, moved.starts, group.size
    late = rig.bus.drive_delay.value if effects.sensor_filter else 0.0
    inside = np.ones(size, dtype=bool)  # a group's first and last sample have no neighbour on one side
    inside[starts] = inside[starts - 1] = False
    turn = 2 * np.pi
    read: dict[str, NDArray[np.float32]] = {}

    def put(name: str, where: slice, values: Array, lsb: float | None = None) -> None:
        if name not in read:
            read[name] = np.empty((size, *values.shape[1:]), dtype=np.float32)
        read[name][where] = values if lsb is None else read_rounded(values, lsb, effects)

    for begin in range(0, size, _BLOCK):
        here = slice(begin, begin + _BLOCK)
        of = group[here]
        driven: dict[str, Any] = {name: np.asarray(getattr(p, name))[of] for name in _DRIVEN}
        each = p._replace(**driven)
        own_time = (np.arange(begin, begin + of.size) - starts[of]) / sample_hz
        sine = np.asarray(each.amplitude * np.sin(each.omega * own_time))
        put("drive_command_rad", here, np.where(own_time < each.stop_s, sine, 0.0))
        duty: Any = moved.duty[here]
        rate: Any = moved.lever_rate[here]
        put("drive_rad", here, moved.lever[here] - late * rate, turn / drive.counts_per_turn.value)
        put("drive_current_a", here, np.asarray(motor_current(duty, rate, each)), drive.current_lsb.value)
        put("drive_pwm", here, duty, drive.duty_lsb.value)

        around = slice(max(begin - 1, 0), min(begin + _BLOCK + 1, size))  # with a neighbour on either side
        own = slice(begin - around.start, begin - around.start + of.size)
        taken_up = _take_up(moved, tension, group, around, rig) / tendons.pulley_radius.value
        pull = tendons.current(tension[around])
        put("tendon_rad", here, taken_up[own], turn / tendons.counts_per_turn.value)
        put("tendon_current_a", here, pull[own], tendons.current_lsb.value)
        held = _tendon_duty(pull, taken_up, inside[around], sample_hz, rig)
        put("tendon_pwm", here, held[own], drive.duty_lsb.value)
    return read


_DRIVEN = ("amplitude", "omega", "stop_s", "duty_torque", "speed_slope", "torque_constant")
"""Parameters that the readings of the drive depend on."""


def _tendon_duty(
    current: Array, angle: Array, inside: NDArray[np.bool_], sample_hz: float, rig: RigSpec
) -> NDArray[np.float64]:
    """Return the duty of the tendon motors, (sample, tendon), for their current [A] and angle [rad] of that shape.

    inside: which samples have a neighbour of their group on either side (sample,).

    (R i + k_e ω)/V: what holds the current against winding and back-EMF. R and k_e of the model's data sheet: nominal
    voltage over stall current, and over no-load speed.
    """
    servo = SERVOS[rig.wiring.tendon_model]
    supply = rig.drive.supply_voltage.value
    duty = (servo.resistance / supply) * current
    turned = angle[2:] - angle[:-2]
    duty[1:-1] += (servo.nominal_voltage / servo.no_load_speed / supply * 0.5 * sample_hz) * turned * inside[1:-1, None]
    return np.asarray(np.clip(duty, -1.0, 1.0))


def _take_up(moved: Moved, tension: Array, group: NDArray[np.intp], where: slice, rig: RigSpec) -> NDArray[np.float64]:
    """Return how much cable the motors have taken up since first contact [m], of some samples (sample, tendon).

    A group starts at rest with its pretension taken up, less what the servo gives way under the added tension;
    then the motor follows its command, length and tension: Δw = -Δℓ + ΔT/k_cable.
    """
    cable, servo = rig.tendons.cable_stiffness.value, rig.tendons.servo_stiffness.value
    contact = rig.tendons.first_contact_tension.value
    rest = moved.starts[group[where]]
    followed = -(moved.stretch[where] - moved.stretch[rest]) + (tension[where] - tension[rest]) / cable
    at_rest = moved.at_rest[group[where]]
    return np.asarray(at_rest - (tension[rest] - contact) / servo + followed + moved.driven[where])
