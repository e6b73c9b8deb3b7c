"""The score check's statistics: against SciPy and by hand, and its error rates by simulation, with fixed seeds."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats

from harness.play.evaluation import evaluate
from harness.regression import judging, statistics
from harness.regression.rows import Limits, Row, StoredScore
from harness.regression.scoring import Measurement
from harness.score.paired import holm

ROWS = 20
LISTS = 20_000
LIMITS = Limits()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("min_effect", [0.0, 0.3])
def test_welch_is_scipys(seed, min_effect):
    generator = np.random.default_rng(seed)
    old = generator.normal(2, 3, size=generator.integers(30, 200))
    new = generator.normal(1.5, 1 + seed, size=generator.integers(30, 200))
    expected = stats.ttest_ind(old - min_effect, new, equal_var=False, alternative="greater").pvalue
    assert statistics.welch(_summary(old), _summary(new), min_effect) == pytest.approx(expected, rel=1e-9)


def test_welch_against_a_constant_is_the_one_sample_test():
    new = np.random.default_rng(1).normal(9.9, 1, size=50)
    expected = stats.ttest_1samp(new, 10 - 0.05, alternative="less").pvalue
    assert statistics.welch((10.0, 0.0, 50), _summary(new)) == pytest.approx(expected, rel=1e-9)


def test_without_variance_any_drop_above_the_minimal_effect_counts():
    old = (10.0, 0.0, 100)
    assert statistics.welch(old, (9.9, 0.0, 100)) == 0
    assert statistics.welch(old, (9.96, 0.0, 100)) == 1
    assert statistics.welch(old, (10.0, 0.0, 100)) == 1
    assert statistics.welch(old, (11.0, 0.0, 100)) == 1


def test_holm_by_hand():
    # sorted 0.005 0.01 0.03 0.04 times 4 3 2 1, made monotone
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.9]) == [1.0, 1.0]
    assert holm([]) == []
    assert holm([0.01], family=5) == [0.05]  # four more rows are still to come


def test_planned_episodes_give_the_planned_drop():
    for deviation in (1.0, 15.5, 300.0):
        n = statistics.episodes_needed(deviation, ROWS)
        assert statistics.smallest_drop(deviation / n**0.5, n, ROWS) == pytest.approx(1, rel=0.02)
    assert statistics.episodes_needed(0.0, ROWS) == 1
    assert statistics.episodes_needed(15.5, 100) < 40_000  # what a row of 10,000 may stretch to, and more


def test_unchanged_code_fails_once_in_a_thousand_lists_where_nothing_is_conceded():
    """The hardest null: no minimal effect. Neither more often than stated, nor a test that never fails."""
    generator = np.random.default_rng(2026)
    failed = sum(
        _worst_p(_normal_means(generator, 5000, 15.5, 30_000), 0.0).le(LIMITS.false_alarm) for _ in range(20)
    )  # 100,000 lists: 100 failures expected, standard deviation 10
    assert 60 <= failed <= 140


def test_unchanged_code_hardly_ever_fails_as_shipped():
    """The upper end of the 99 % interval of the rate lies below one in a thousand."""
    pairs = _normal_means(np.random.default_rng(1), LISTS, 15.5, 30_000)
    failed = _worst_p(pairs, LIMITS.min_effect).le(LIMITS.false_alarm)
    assert _upper_limit(failed, LISTS) < 0.001


def test_a_drop_of_one_unit_is_caught():
    """One of twenty rows lost one unit: of 20,000 checks so few miss it that the rate is below one in a thousand."""
    n = statistics.episodes_needed(15.5, 100)
    pairs = _normal_means(np.random.default_rng(3), LISTS, 15.5, n)
    pairs.new_mean[:, 0] -= 1.0
    p = pairs.p_values(LIMITS.min_effect)[:, 0]
    missed = int((p > LIMITS.false_alarm / ROWS).sum())  # Holm's strictest step: what the other rows do is no help
    assert _upper_limit(missed, LISTS) < 0.001


def test_ten_thousand_episodes_alone_would_not_do():
    """Why stored scores rest on more: of 10,000 against 10,000 episodes, one check in ten and more misses the drop."""
    pairs = _normal_means(np.random.default_rng(3), LISTS, 15.5, 10_000)
    pairs.new_mean[:, 0] -= 1.0
    missed = (pairs.p_values(LIMITS.min_effect)[:, 0] > LIMITS.false_alarm / ROWS).mean()
    assert missed > 0.1


REAL = (
    ("rocksample-7x8", "random-legal"),
    ("rocksample-7x8", "accuracy:0.93"),
    ("rocksample-7x8", "belief:0.84"),
    ("bordercross-7x8", "random"),
    ("bordercross-7x8", "random-legal"),  # 500 in one episode of 200, else 0: as skewed as it gets
)


@pytest.fixture(scope="module")
def real_returns():
    return [evaluate(domain, spec, episodes=20_000, seed=9, engine="tables").returns for domain, spec in REAL]


def test_error_rates_hold_for_real_returns(real_returns):
    """Both sides drawn anew from real episodes: four rows of each of five policies, as many episodes as are planned."""
    generator = np.random.default_rng(5)
    p_columns = []
    for returns in real_returns:
        n = min(statistics.episodes_needed(returns.std(ddof=1), 100), 200_000)
        pairs = _resampled(generator, returns, LISTS * 4, n)
        p_columns.append(pairs.p_values(LIMITS.min_effect).reshape(LISTS, 4))
        if n < 200_000:
            pairs.new_mean -= 1.0
            missed = int((pairs.p_values(LIMITS.min_effect) > LIMITS.false_alarm / ROWS).sum())
            assert _upper_limit(missed, LISTS * 4) < 0.001
    failed = int((np.concatenate(p_columns, axis=1).min(axis=1) * ROWS <= LIMITS.false_alarm).sum())
    assert failed > 0  # a test that never fails would show nothing
    assert _upper_limit(failed, LISTS) < 0.001


def test_skewed_returns_hold_the_rate_with_equal_numbers_only(real_returns):
    """The reason for playing as many episodes as the stored score rests on."""
    generator = np.random.default_rng(6)
    returns = real_returns[-1]
    level = 1e-3
    equal = _resampled(generator, returns, 100_000, 10_000, 10_000).p_values(0.0)
    unequal = _resampled(generator, returns, 100_000, 100_000, 10_000).p_values(0.0)
    assert (equal <= level).mean() < 1.4 * level
    assert (unequal <= level).mean() > 2 * level


def test_the_simulated_tests_are_the_ones_that_judge():
    """The vectorised p-values above against ``judge``, on a few of the same lists."""
    pairs = _normal_means(np.random.default_rng(7), 3, 15.5, 30_000)
    pairs.new_mean[0, 4] -= 1.0
    for k in range(3):
        sides = zip(pairs.old_mean[k], pairs.old_sem[k], pairs.new_mean[k], pairs.new_sem[k], strict=True)
        measurements = [_measurement(i, *numbers, pairs.n) for i, numbers in enumerate(sides)]
        outcomes = judging.judge(measurements, LIMITS)
        raw = pairs.p_values(LIMITS.min_effect)[k]
        assert min(o.p for o in outcomes) == pytest.approx(min(1, ROWS * raw.min()), rel=1e-6)
        assert [o.passed for o in outcomes] == [not (k == 0 and i == 4) for i in range(ROWS)]


def _summary(values):
    return float(values.mean()), float(values.std(ddof=1) / len(values) ** 0.5), len(values)


@dataclasses.dataclass
class _Pairs:
    """Means and standard errors of both sides, arrays of equal shape, from n episodes each (new: m)."""

    old_mean: np.ndarray
    old_sem: np.ndarray
    new_mean: np.ndarray
    new_sem: np.ndarray
    n: int
    m: int

    def p_values(self, min_effect):
        n, m = self.n, self.m
        return stats.ttest_ind_from_stats(
            self.old_mean - min_effect,
            self.old_sem * n**0.5,
            n,
            self.new_mean,
            self.new_sem * m**0.5,
            m,
            equal_var=False,
            alternative="greater",
        ).pvalue


@dataclasses.dataclass
class _Worst:
    p: np.ndarray

    def le(self, level):
        return int((self.p <= level).sum())


def _worst_p(pairs, min_effect):
    """The smallest Holm-corrected p-value of each list: what decides whether the check fails."""
    return _Worst(pairs.p_values(min_effect).min(axis=1) * ROWS)


def _normal_means(generator, lists, deviation, n):
    """Sufficient statistics of n normal returns on both sides, for every row of every list."""
    shape = (lists, ROWS)

    def side():
        mean = generator.normal(0, deviation / n**0.5, shape)
        return mean, deviation * np.sqrt(generator.chisquare(n - 1, shape) / (n - 1) / n)

    return _Pairs(*side(), *side(), n, n)


def _resampled(generator, returns, size, n, m=None):
    """Means and standard errors of n (m) returns drawn with replacement."""
    values, counts = np.unique(returns, return_counts=True)

    def side(number):
        drawn = generator.multinomial(number, counts / counts.sum(), size=size)
        mean = drawn @ values / number
        variance = (drawn @ values**2 / number - mean**2) * number / (number - 1)
        return mean, np.sqrt(variance / number)

    return _Pairs(*side(n), *side(m or n), n, m or n)


def _upper_limit(count, trials, confidence=0.99):
    """Clopper and Pearson's upper limit of a rate."""
    return stats.beta.ppf(confidence, count + 1, trials - count)


def _measurement(index, old_mean, old_sem, new_mean, new_sem, n):
    row = Row("d", f"p{index}")
    old = StoredScore("d", row.policy, 50, 1, "h", "tables", 0, 10_000, "x", n, old_mean, old_sem, 0, 0, 1, 1)
    new = dataclasses.replace(old, digest="y", mean=new_mean, sem=new_sem)
    return Measurement(row, old, new, equal=False)
