"""Maximum likelihood of modes on free decays: the last step of the modal identification.

A free decay is a sum of ``shape amplitude exp(pole t)``.  A mode has one pole and one shape in all
runs, and in each run its own amplitude; each channel has white noise of its own level.  Poles and
shapes are found together by Levenberg-Marquardt, with the best amplitudes for each: those of one
run are not coupled with those of another, so the cost grows with the number of runs, not with its
cube.

A step needs the samples only as far as ``exp(pole t)`` and ``t exp(pole t)`` can follow them, which
four numbers a mode describe (`condense`), however many samples there are.  The curvature of the
likelihood gives the Cramer-Rao bound of every pole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dbc.frames import read_only

from ..model.chi_squared import exceeded_by_chance
from ..model.exponentials import Series, series_of, waves, waves_of
from ..model.matrices import Complex, Real
from .modal_model import ModalModel, vibrates

_RIDGE = 4e-14
"""Share of a normal matrix's scale below which rounding decides a direction."""

# Samples, and as much of them as modes can follow -------------------------------------------------


@dataclass(frozen=True, slots=True)
class Block:
    """Samples of some channels in some runs, all at the same instants."""

    time_s: Real
    """Times since the start of the decay, s, shape (n,)."""
    values: Real
    """Samples, less their mean: the level of a sensor is unknown; shape (n, n_runs, n_channels)."""
    runs: NDArray[np.intp]
    channels: NDArray[np.intp]
    """`runs`, `channels`: their indices; each pair occurs in one block only."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(self.values - self.values.mean(axis=0)))


def even_blocks(decays: Sequence[Real], rate_hz: float) -> tuple[Block, ...]:
    """Return evenly sampled records, (n_i, n_channels), as blocks, one for each length."""
    lengths = np.array([len(decay) for decay in decays])
    channels = np.arange(decays[0].shape[1])
    blocks = []
    for length in sorted(set(lengths.tolist())):
        runs = np.flatnonzero(lengths == length)
        values = np.stack([decays[run] for run in runs.tolist()], axis=1)
        blocks.append(Block(np.arange(length) / rate_hz, values, runs, channels))
    return tuple(blocks)


@dataclass(frozen=True, slots=True)
class Samples:
    """All blocks of samples; no channel may be all zeros."""

    blocks: tuple[Block, ...]
    series: tuple[Series, ...]
    """The blocks laid out for sums with any poles, those that are sampled alike together."""
    block_of: NDArray[np.intp]
    """Index of the block of each series, -1 where there is none, (n_runs, n_channels)."""
    power: Real
    """Sum of the squares of each series, (n_runs, n_channels)."""
    count: Real
    """Number of samples of each channel, (n_channels,)."""

    @property
    def longest_s(self) -> float:
        """Time of the last sample of the longest series, s."""
        return max(float(block.time_s[-1]) for block in self.blocks)

    def gain_by_noise(self, poles: Complex) -> float:
        """Return what modes with these poles may add to `Point.log_likelihood` by following noise.

        Each free number gains about 1, so a mode's gain is chi-squared distributed; and noise may
        look like a mode at as many frequencies as there are samples, the best of which is chosen.
        """
        n_unknowns = sum(self.block_of.shape)  # an amplitude a run, an entry a channel
        n_samples = self.count.sum() // len(self.count)  # of one channel
        chance = 1e-3 / n_samples  # in one of 1000 records noise alone makes a mode
        n_pairs = int(np.sum(poles.imag > 0.0))  # their unknowns are complex
        gain = n_pairs * exceeded_by_chance(2 * n_unknowns, chance)
        return gain + (len(poles) - n_pairs) * exceeded_by_chance(n_unknowns, chance)


def gathered(blocks: Sequence[Block]) -> Samples:
    """Return the samples of some blocks, laid out once for all fits of them."""
    n_runs = 1 + max(int(block.runs.max()) for block in blocks)
    n_channels = 1 + max(int(block.channels.max()) for block in blocks)
    block_of = np.full((n_runs, n_channels), -1)
    power, count = np.zeros((n_runs, n_channels)), np.zeros(n_channels)
    for i, block in enumerate(blocks):
        block_of[np.ix_(block.runs, block.channels)] = i
        power[np.ix_(block.runs, block.channels)] = np.sum(block.values**2, axis=0)
        count[block.channels] += len(block.time_s) * len(block.runs)
    values = [block.values.reshape(len(block.time_s), -1) for block in blocks]
    series = series_of([block.time_s for block in blocks], values)
    return Samples(tuple(blocks), series, block_of, power, count)


@dataclass(frozen=True, slots=True)
class Condensed:
    """Samples and exponentials in p orthonormal directions that the exponentials span.

    Each function is taken less its mean: the part that a constant can follow shows nothing about
    modes.
    """

    samples: Samples
    poles: Complex
    """rad/s, shape (m,)."""
    wave: Complex
    timed: Complex
    """`wave`, `timed`: ``exp(pole t)`` and ``t exp(pole t)`` for each series, (n_runs, n_channels,
    p, m); zero where there is none."""
    values: Real
    """Samples, (n_runs, n_channels, p)."""
    beyond: Real
    """Sum of the squares of what no exponential can follow, (n_channels,)."""


def condense(samples: Samples, poles: Complex) -> Condensed:
    """Return all samples in the directions of the exponentials of some poles."""
    m = len(poles)
    # exp(pole t) and t exp(pole t) of each block; of the last one, which stands for none, zeros.
    functions = np.zeros((len(samples.blocks) + 1, 4 * m, 2 * m), complex)
    values = np.zeros((*samples.block_of.shape, 4 * m))
    for series in samples.series if m else ():
        # exp(pole t), 1, t exp(pole t), t: products with the constant are sums of the others.
        with_constant = waves_of(series, np.append(poles, 0.0))
        grams, of_poles = with_constant.grams(), np.delete(np.arange(2 * m + 2), [m, 2 * m + 1])
        conjugate, plain = (gram[:, of_poles[:, None], of_poles] for gram in grams)
        sums = grams[1][:, m, of_poles]
        squares = np.einsum("rii->ri", conjugate.real)
        means = sums / series.count[:, None]
        conjugate = conjugate - sums.conj()[:, :, None] * means[:, None]
        plain = plain - sums[:, :, None] * means[:, None]
        real_sum, real_gap = conjugate + plain, conjugate - plain
        # Real parts of all functions, then their imaginary parts with the opposite sign.
        gram = np.block([[real_sum.real, -real_sum.imag], [real_gap.imag, real_gap.real]])
        root, inverse = _roots(gram / 2.0, squares)
        functions[list(series.members)] = root[..., : 2 * m] - 1j * root[..., 2 * m :]
        coordinates = _real_parts(with_constant.with_samples()[..., of_poles]) @ inverse
        for number, of_block in zip(series.members, coordinates, strict=True):
            runs, channels = samples.blocks[number].runs, samples.blocks[number].channels
            values[runs[:, None], channels] = of_block.reshape(len(runs), len(channels), -1)
    # What no exponential follows: the squares of the samples less those of their coordinates.
    beyond = (samples.power - np.sum(values**2, axis=2)).sum(axis=0)
    power = samples.power.sum(axis=0)
    # So little power left by sums of products is rounding: the samples themselves are taken.
    if m and np.any(beyond < 1e-6 * power):
        beyond = np.zeros(len(power))
        for number, block in enumerate(samples.blocks):
            wave = waves(block.time_s, poles)
            both = np.hstack([wave, block.time_s[:, None] * wave])  # exp and t exp
            basis, root = np.linalg.qr(_real_parts(both - both.mean(axis=0)))
            functions[number, : len(root)] = root[:, : 2 * m] - 1j * root[:, 2 * m :]
            coordinates = np.einsum("np,nrc->rcp", basis, block.values)
            followed = np.einsum("np,rcp->nrc", basis, coordinates)
            runs, channels = np.ix_(block.runs, block.channels)
            values[runs, channels] = 0.0
            values[runs, channels, : len(root)] = coordinates
            beyond[block.channels] += np.sum((block.values - followed) ** 2, axis=(0, 1))
    beyond += 1e-24 * power  # less noise cannot be distinguished from rounding
    wave, timed = functions[..., :m][samples.block_of], functions[..., m:][samples.block_of]
    return Condensed(samples, poles, wave, timed, values, beyond)


# Complex unknowns as real ones: the derivatives of the real part of ``c f`` by the real and by the
# imaginary part of c are the real part of f and its imaginary part with the opposite sign.


def _real_parts(functions: Complex) -> Real:
    """Return real parts, and imaginary parts with the opposite sign, along the last axis."""
    return np.concatenate([functions.real, -functions.imag], axis=-1)


def _complex(parts: Real) -> Complex:
    """Return complex numbers from their real parts (first half of the last axis) and imaginary."""
    half = parts.shape[-1] // 2
    return np.asarray(parts[..., :half] + 1j * parts[..., half:])


def _unit_diagonal(normal: Real) -> tuple[Real, Real]:
    """Return normal matrices scaled to a diagonal of 1 (or 0), and the factors of the unknowns."""
    diagonal = np.einsum("...ii->...i", normal)
    scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 0.0)
    return normal * scale[..., None, :] * scale[..., None], scale


def _roots(normal: Real, squares: Real | None = None) -> tuple[Real, Real]:
    """Return upper roots R of normal matrices, ``R^T R``, and their inverses, each (.., 2 k, 2 k).

    Of each complex unknown the real part is in the first half, the imaginary part in the second.
    Unknowns without effect are zero in both roots; what rounding decides is held by a ridge.

    `squares`, (.., k): sums of squares before anything was subtracted, of which rounding is a
    share; by default those on the matrices' diagonals.
    """
    diagonal = np.einsum("...ii->...i", normal)
    if squares is None:
        squares = np.add(*np.split(diagonal, 2, axis=-1))
    size = np.tile(np.sqrt(np.where(squares > 0.0, squares, 1.0)), 2)
    unit = normal / (size[..., None, :] * size[..., None])
    lower = np.linalg.cholesky(unit + _RIDGE * np.eye(unit.shape[-1]))
    upper, has_effect = lower.swapaxes(-1, -2), diagonal > 0.0
    inverse = np.linalg.inv(upper) * (has_effect / size)[..., None]
    return upper * (has_effect * size)[..., None, :], inverse


# The point of a fit -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Point:
    """Poles, shapes, and the amplitudes of each run that fit best."""

    condensed: Condensed
    shapes: Complex
    """Shape (n_channels, m)."""
    amplitudes: Complex
    """Shape (n_runs, m)."""
    inverse: Real
    """Inverse root of the normal equations of the amplitudes, (n_runs, 2 m, 2 m)."""
    residuals: Real
    """Condensed samples less those of the modes, (n_runs, n_channels, p)."""
    squares: Real
    """Squared residuals of each channel, (n_channels,)."""

    @property
    def poles(self) -> Complex:
        """One of each conjugate pair, and real ones, rad/s, (m,)."""
        return self.condensed.poles

    @property
    def weight(self) -> Real:
        """Inverse variance of each channel's noise, (n_channels,)."""
        return self.condensed.samples.count / self.squares

    @property
    def log_likelihood(self) -> float:
        """Twice the logarithm of the likelihood, without constants."""
        return float(np.sum(self.condensed.samples.count * np.log(self.weight)))

    @property
    def merit(self) -> float:
        """Likelihood less what as many modes would gain from noise."""
        return self.log_likelihood - self.condensed.samples.gain_by_noise(self.poles)

    def least_needed(self) -> tuple[int, float]:
        """Return the mode whose absence costs the least likelihood, and about this cost.

        The amplitudes of all other modes follow; their poles and shapes stay.
        """
        m = len(self.poles)
        # An amplitude (x, y) with the covariance [[xx, xy], [xy, yy]] costs its square in units of
        # that; that of a real pole has no y.  Each (n_runs, m).
        covariance = self.inverse @ self.inverse.swapaxes(1, 2)
        xx, yy = np.split(np.einsum("rii->ri", covariance), 2, axis=1)
        xy = np.einsum("rii->ri", covariance[:, :m, m:])
        x, y = self.amplitudes.real, self.amplitudes.imag
        square = yy * x**2 - 2.0 * xy * x * y + xx * y**2
        of_pairs = square / np.maximum(xx * yy - xy**2, 1e-300)  # never a division by zero
        of_real_poles = x**2 / np.maximum(xx, 1e-300)
        costs = np.where(self.poles.imag > 0.0, of_pairs, of_real_poles).sum(axis=0)
        return int(np.argmin(costs)), float(costs.min())

    def without(self, mode: int) -> Point:
        """Return the point without a mode, all amplitudes and shapes fitted anew."""
        kept, of_all = np.delete(np.arange(len(self.poles)), mode), self.condensed
        wave, timed = of_all.wave[..., kept], of_all.timed[..., kept]
        condensed = replace(of_all, poles=of_all.poles[kept], wave=wave, timed=timed)
        return fitted_at(condensed, self.shapes[:, kept], 2)


def point_at(condensed: Condensed, shapes: Complex, weight: Real) -> Point:
    """Return the point of given shapes; `weight`: inverse noise variances, (n_channels,)."""
    slopes = _real_parts(condensed.wave * shapes[:, None])
    weighted_slopes = (slopes * weight[:, None, None]).swapaxes(2, 3)
    _, inverse = _roots((weighted_slopes @ slopes).sum(axis=1))
    solution, residuals = np.zeros((*inverse.shape[:2], 1)), condensed.values
    for _ in range(3):  # the second and third time take back what the ridge holds
        target = (weighted_slopes @ residuals[..., None]).sum(axis=1)
        solution = solution + inverse @ (inverse.swapaxes(1, 2) @ target)
        residuals = condensed.values - (slopes @ solution[:, None])[..., 0]
    amplitudes = _complex(solution[..., 0])
    squares = np.einsum("rcp,rcp->c", residuals, residuals) + condensed.beyond
    return Point(condensed, shapes, amplitudes, inverse, residuals, squares)


def fitted_at(condensed: Condensed, shapes: Complex, sweeps: int = 1) -> Point:
    """Return the point of given poles near some shapes, (n_channels, m).

    In each sweep amplitudes and then shapes are fitted by least squares.
    """
    samples = condensed.samples
    start_shapes = np.where(condensed.poles.imag > 0.0, shapes, shapes.real)  # of a real pole
    point = point_at(condensed, start_shapes, samples.count / samples.power.sum(axis=0))
    for _ in range(sweeps):
        point = _with_best_shapes(point)
    return point


def _with_best_shapes(point: Point) -> Point:
    """Return the point with the shapes that fit its amplitudes best, and their best amplitudes."""
    slopes = _real_parts(point.condensed.wave * point.amplitudes[:, None, None])
    transposed = slopes.swapaxes(2, 3)
    target = (transposed @ point.residuals[..., None]).sum(axis=0)
    _, inverse = _roots((transposed @ slopes).sum(axis=0))
    step = _complex((inverse @ (inverse.swapaxes(1, 2) @ target))[..., 0])
    return point_at(point.condensed, point.shapes + step, point.weight)


# The fit ------------------------------------------------------------------------------------------

_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-12, 1e8
"""Levenberg-Marquardt damping of unknowns whose normal matrix has a diagonal of 1."""
_DAMPING_FACTOR = 3.0
"""Change of damping from trial to trial.  Modes that nearly coincide make a curved valley, in which
a factor of 10 refuses every second step."""


@dataclass(frozen=True, slots=True)
class System:
    """Normal equations of the poles and then of each channel's shapes, N = 2 m (1 + n_channels).

    The amplitudes are eliminated; before that, the diagonal was 1.  Unknowns that are held have 0.
    """

    n_poles: int
    normal: Real
    gradient: Real
    """`normal`, `gradient`: shapes (N, N) and (N,)."""
    scale: Real
    """Units of the unknowns, (N,); 0 if held."""

    def scaled_step(self, damping: float) -> Real:
        """Return the step of all unknowns as multiples of `scale`, (N,)."""
        damped = self.normal + (damping + _RIDGE) * np.eye(len(self.scale))
        return np.asarray(np.linalg.solve(damped, self.gradient))

    def step(self, damping: float) -> tuple[Complex, Complex]:
        """Return the steps of poles, (m,), and shapes, (n_channels, m)."""
        step = self.scale * self.scaled_step(damping)
        poles, *shapes = _complex(step.reshape(-1, 2 * self.n_poles))
        return poles, np.array(shapes)

    def pole_covariance(self) -> Real:
        """Return the covariance of the real and then the imaginary parts of the poles."""
        n = 2 * self.n_poles
        # So small a ridge does not make weak shapes look better known.
        normal = self.normal + np.diag((self.scale == 0.0) + 1e-16)
        mixed = normal[:n, n:]
        information = normal[:n, :n] - mixed @ np.linalg.solve(normal[n:, n:], mixed.T)
        # A mode without information has no bound: its variance is left large.
        scaled, size = _unit_diagonal(information)
        strength, directions = np.linalg.eigh(scaled)
        inverse = (directions / np.maximum(strength, 1e-15)) @ directions.T
        factor = self.scale[:n] * size
        return np.asarray(inverse * factor * factor[:, None])


def linearised(point: Point) -> System:
    """Return the normal equations of poles and shapes at a point (Gauss-Newton)."""
    condensed, m, weight = point.condensed, len(point.poles), point.weight
    point = point_at(condensed, point.shapes, weight)
    amplitudes, n_channels = point.amplitudes[:, None], len(point.shapes)
    # Slopes of the motion by the amplitudes of a run, the shapes, and the poles.
    factors = point.shapes, amplitudes, amplitudes * point.shapes
    functions = condensed.wave, condensed.wave, condensed.timed
    pairs = zip(functions, factors, strict=True)
    slopes = np.concatenate([_real_parts(f * factor[..., None, :]) for f, factor in pairs], axis=-1)
    weighted_slopes = (slopes * weight[:, None, None]).swapaxes(2, 3)
    products = weighted_slopes @ slopes
    gradients = (weighted_slopes @ point.residuals[..., None])[..., 0]
    amplitude, shape, pole = (slice(start, start + 2 * m) for start in (0, 2 * m, 4 * m))
    # Products of the amplitudes with the poles (first) and with the shapes of each channel.
    mixed = np.empty((len(products), 2 * m, 1 + n_channels, 2 * m))
    mixed[:, :, 0] = products[:, :, amplitude, pole].sum(axis=1)
    mixed[:, :, 1:] = products[:, :, amplitude, shape].swapaxes(1, 2)
    normal = np.zeros((1 + n_channels, 2 * m, 1 + n_channels, 2 * m))
    channels = np.arange(1, 1 + n_channels)
    normal[0, :, 0] = products[:, :, pole, pole].sum(axis=(0, 1))
    normal[channels, :, channels] = products[:, :, shape, shape].sum(axis=0)
    normal[1:, :, 0] = products[:, :, shape, pole].sum(axis=0)
    normal[0, :, 1:] = normal[1:, :, 0].transpose(2, 0, 1)
    gradient = np.vstack(
        [gradients[:, :, pole].sum(axis=(0, 1)), gradients[:, :, shape].sum(axis=0)]
    )
    # Amplitudes are eliminated run by run; they are the best ones, and add nothing to the gradient.
    eliminated = point.inverse.swapaxes(1, 2) @ mixed.reshape(len(mixed), 2 * m, -1)
    eliminated = eliminated.reshape(-1, gradient.size)
    reduced = normal.reshape(gradient.size, -1) - eliminated.T @ eliminated
    # The largest entry of each shape sets its scale.
    is_free = np.ones((1 + n_channels, 2, m), dtype=bool)
    is_free[1 + np.argmax(np.abs(point.shapes), axis=0), :, np.arange(m)] = False
    _, scale = _unit_diagonal(normal.reshape(gradient.size, -1))
    scale *= is_free.ravel()
    scaled = reduced * scale * scale[:, None]
    return System(m, scaled, scale * gradient.ravel(), scale)


@dataclass(frozen=True, slots=True)
class LikelyModes:
    """Modes of the highest likelihood."""

    point: Point
    pole_covariance: Real
    """Covariance of the real and then of the imaginary parts of the poles, (rad/s)^2, shape (2 m, 2
    m)."""
    n_unknowns: int
    """Number of fitted numbers, levels of the sensors included."""

    @property
    def poles(self) -> Complex:
        """One of each conjugate pair, and real ones, in the order of the start, rad/s, (m,)."""
        return self.point.poles

    @property
    def shapes(self) -> Complex:
        """Entries in each channel, (n_channels, m)."""
        return self.point.shapes

    @property
    def noise(self) -> Real:
        """Standard deviation of each channel, (n_channels,)."""
        share = _noise_share(self.n_unknowns, self.point.condensed.samples.count)
        return np.asarray(np.sqrt(1.0 / self.point.weight / share))

    def model(self) -> ModalModel:
        """Return the modes that vibrate, with their deviations by the Cramer-Rao bound."""
        poles, size, m = self.poles, np.abs(self.poles), len(self.poles)
        real, imag = poles.real, poles.imag
        # Variances of the real and of the imaginary part of each pole, and their covariance, (m,).
        rr, ii = np.split(np.diag(self.pole_covariance), 2)
        ri = np.diag(self.pole_covariance[:m, m:])
        size_variance = (real**2 * rr + 2.0 * real * imag * ri + imag**2 * ii) / size**2
        angle_variance = (imag**2 * rr - 2.0 * real * imag * ri + real**2 * ii) / size**4
        frequency_std_hz = np.sqrt(size_variance) / (2.0 * np.pi)
        damping_std = np.abs(imag) / size * np.sqrt(angle_variance)
        periods = size * self.point.condensed.samples.longest_s / (2.0 * np.pi)
        # What does not swing for a quarter of a period is a drift of the record.
        is_mode = vibrates(poles) & (periods > 0.25)
        return ModalModel(
            poles[is_mode], self.shapes[:, is_mode], frequency_std_hz[is_mode], damping_std[is_mode]
        )


def most_likely_modes(
    samples: Samples,
    poles: Complex,
    shapes: Complex,
    most_steps: int = 25,
    wanted_likelihood: float = -np.inf,
    least_gain: float = 1e-3,
) -> LikelyModes:
    """Return the poles, shapes and amplitudes that all samples at once make most likely.

    `poles` (m,) rad/s, imaginary parts of at least zero, m >= 1, and `shapes` (n_channels, m):
    where to start; a real pole stays real.  A step that gains less than `least_gain` is the last.
    After `most_steps`, or as soon as `wanted_likelihood` (that of a `Point`) is clearly out of
    reach, the fit ends unsettled.
    """
    start = point = fitted_at(condense(samples, poles), shapes)
    damping, system = _FIRST_DAMPING, linearised(point)
    for _ in range(most_steps):
        # The gain by a whole step, if the equations were linear.
        if system.gradient @ system.scaled_step(0.0) < least_gain:
            break
        old_likelihood, trial = point.log_likelihood, None
        while trial is None and damping < _MOST_DAMPING:
            trial = _moved(point, system, damping)
            if trial is None:  # if it is the first step, the start is far from the optimum
                damping = max(damping * _DAMPING_FACTOR, 1.0 if point is start else 0.0)
        if trial is not None:
            damping, point = max(damping / _DAMPING_FACTOR, _LEAST_DAMPING), trial
        gain = point.log_likelihood - old_likelihood
        system = linearised(point)
        # Gains decrease: all further steps together may add eight times the last one.
        if gain < least_gain or 8.0 * gain < wanted_likelihood - point.log_likelihood:
            break
    n_levels = np.sum(samples.block_of >= 0)
    n_shapes_and_poles = np.sum(system.scale > 0.0)
    # An amplitude of a pair has two real numbers, that of a real pole one.
    n_amplitudes = len(point.amplitudes) * np.sum(np.where(point.poles.imag > 0.0, 2, 1))
    n_unknowns = int(n_levels + n_shapes_and_poles + n_amplitudes)
    covariance = system.pole_covariance() / _noise_share(n_unknowns, samples.count)
    return LikelyModes(point, read_only(covariance), n_unknowns)


def _noise_share(n_unknowns: int, count: Real) -> float:
    """Return the share of the samples' power that a fit of noise leaves."""
    return max(1.0 - n_unknowns / float(count.sum()), 1e-3)  # above zero for few samples


def _moved(point: Point, system: System, damping: float) -> Point | None:
    """Return the point after a step; None if it is not better."""
    samples = point.condensed.samples
    pole_step, shape_step = system.step(damping)
    poles = point.poles + pole_step
    is_pair = point.poles.imag > 0.0
    is_growing = poles.real * samples.longest_s > 30.0  # nepers: more would overflow
    if np.any(poles.imag[is_pair] <= 0.0) or np.any(is_growing):
        return None
    condensed = condense(samples, poles)
    trial = _with_best_shapes(point_at(condensed, point.shapes + shape_step, point.weight))
    return trial if trial.log_likelihood >= point.log_likelihood else None
