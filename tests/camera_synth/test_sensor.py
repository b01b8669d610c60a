"""The sensor's noise: mean, spread, shape, spectrum; independent over pixels, rows, frames and vehicles."""

import numpy as np
import pytest
from scipy import stats
from shots import plain, shoot

from tests.roads import road_ahead

GREY, SIGMA = 120.0, 8.0
FLAT = {"asphalt_grey": GREY, "verge_grey": GREY, "paint_grey": GREY, "noise_grey": SIGMA}
ROAD = road_ahead(np.zeros(3), kinds=[0] * 4)


def noise(counter: int, sigma: float = SIGMA) -> np.ndarray:
    """Noise (3 vehicles, 150, 320) of one frame."""
    frames = shoot(ROAD, plain(**{**FLAT, "noise_grey": sigma}), counter=counter, first_row=90)
    return frames[:, 90:].astype(float) - GREY


@pytest.fixture(scope="module")
def fields() -> np.ndarray:
    """(40 frames, 3 vehicles, 150, 320)."""
    return np.stack([noise(counter) for counter in range(40)])


def test_mean_spread_and_shape(fields: np.ndarray) -> None:
    flat = fields.ravel()
    n = len(flat)
    assert abs(flat.mean()) < 5.0 * SIGMA / np.sqrt(n)
    assert flat.std() == pytest.approx(np.hypot(SIGMA, 1 / np.sqrt(12)), rel=0.003)  # with the rounding's
    assert abs(stats.skew(flat)) < 0.01
    assert stats.kurtosis(flat) == pytest.approx(-0.3, abs=0.02)  # four bytes' sum: −6/(5·4)
    # as a distribution within 1 % of the Gaussian's
    levels = np.arange(-24, 25)
    empirical = np.array([(flat <= level).mean() for level in levels])
    np.testing.assert_allclose(empirical, stats.norm.cdf((levels + 0.5) / SIGMA), atol=0.01)


def test_no_correlation_in_the_image(fields: np.ndarray) -> None:
    limit = 5.0 / np.sqrt(fields.size)
    unit = fields / fields.std()
    for dy, dx in ((0, 1), (0, 2), (0, 4), (1, 0), (2, 0), (1, 1), (0, 64), (0, 80), (0, 160), (0, 240)):
        a = unit[:, :, dy:, dx:]
        b = unit[:, :, : 150 - dy, : 320 - dx]
        assert abs(np.mean(a * b)) < limit


def test_no_correlation_between_frames_and_vehicles(fields: np.ndarray) -> None:
    unit = fields / fields.std()
    limit = 5.0 / np.sqrt(fields.size / 3)
    for lag in (1, 2, 7):
        assert abs(np.mean(unit[lag:] * unit[:-lag])) < limit
    for a, b in ((0, 1), (0, 2), (1, 2)):
        assert abs(np.mean(unit[:, a] * unit[:, b])) < limit
    # nor a shifted copy: the cross-correlation of two frames has no peak
    spectrum = np.fft.fft2(unit[0, 0]) * np.conj(np.fft.fft2(unit[1, 0]))
    peak = np.abs(np.fft.ifft2(spectrum).real).max() / unit[0, 0].size
    assert peak < 6.0 / np.sqrt(unit[0, 0].size)


def test_white_spectrum(fields: np.ndarray) -> None:
    power = np.mean(np.abs(np.fft.fft2(fields)) ** 2, axis=(0, 1)) / (150 * 320)
    rows, columns = power.mean(axis=1), power.mean(axis=0)
    variance = fields.var()
    # each is a mean of 120 spectra and of 320 or 150 bins of exponential deviation
    np.testing.assert_allclose(rows, variance, rtol=6.0 / np.sqrt(120 * 160))
    np.testing.assert_allclose(columns, variance, rtol=6.0 / np.sqrt(120 * 75))


def test_strength_is_the_setting() -> None:
    assert noise(3, 0.0).std() == 0.0
    assert noise(3, 3.0).std() == pytest.approx(np.hypot(3.0, 1 / np.sqrt(12)), rel=0.01)
    assert noise(3, 20.0).std() == pytest.approx(20.0, rel=0.01)
