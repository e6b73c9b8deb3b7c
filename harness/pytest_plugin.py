"""The pytest fixture ``score_regression``: scores of a researcher's own policies under regression control.

    def test_my_policy(score_regression):
        score_regression.check(MyPolicy(), "rocksample-7x8")

The first run stores the score beside the test and fails; from then on the test fails when the score gets worse.
A policy object must pass :func:`harness.check_policy` first.
Every pytest run of an environment loads this module, so it imports nothing but pytest.
"""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from harness.model.domain import Domain
    from harness.policy import Policy


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests(parser: pytest.Parser) -> None:
    """Add ``--force-regen``, unless another plugin has: pytest-regressions has the same option for the same purpose.

    At this moment all installed plugins have added theirs; earlier, the other one would stumble over ours.
    """
    with contextlib.suppress(ValueError):  # it is there, and means the same
        parser.getgroup("regressions").addoption(
            "--force-regen",
            action="store_true",
            default=False,
            help="Store scores (and other regression data) anew, failing the tests where they have changed.",
        )


@pytest.fixture
def score_regression(request: pytest.FixtureRequest) -> ScoreRegression:
    """Checks scores of policies against those stored in a folder named like the test module."""
    force = bool(request.config.getoption("force_regen", default=False))
    test = request.node.nodeid.partition("::")[2]  # with the class, so that equal names in two classes are two files
    return ScoreRegression(request.path.with_suffix(""), test.replace("::", "."), force)


class ScoreRegression:
    """What the fixture gives: :meth:`check`."""

    def __init__(self, folder: Path, test: str, force_regen: bool) -> None:
        """``folder`` of the stored scores, name of the ``test``, whether to store anew."""
        self._folder, self._test, self._force = folder, test, force_regen
        self._done: set[Path] = set()

    def check(
        self,
        policy: Policy | str,
        domain: Domain | str,
        *,
        episodes: int = 10_000,
        seed: int = 0,
        horizon: int = 50,
        engine: str = "auto",
        max_episodes: int | None = None,
        exact: bool = False,
        how: str = "sampled",
        name: str | None = None,
        **limits: float,
    ) -> None:
        """Fail the test when the policy's mean return has got worse than the stored one.

        Every check is a family of its own: unchanged code fails at most once in a thousand checks, and never when it
        plays the same episodes. An object that acts otherwise in other batches fails at once.

        Args:
            policy: a policy string, or any object with ``reset`` and ``act`` on batches.
            domain: a domain or its name.
            episodes: played first; where they all come out as stored, that is all.
            seed: of the episodes.
            horizon: steps after which an episode is truncated.
            engine: ``tables``, ``julia`` or ``auto``.
            max_episodes: at most so many behind the stored score (default: 20 times ``episodes``).
            exact: fail unless every episode, or the computed return, comes out as stored.
            how: ``sampled``, or ``exact``: the expected return is computed, by :func:`harness.exact`, and no episode
                is played for it.
            name: of the stored file, instead of the test's; needed for a second check in one test.
            limits: ``false_alarm``, ``min_effect``, ``drop``, ``power``, as in :class:`harness.regression.rows.Limits`.

        Raises:
            HarnessError: an argument is wrong.
        """
        __tracebackhide__ = True
        from harness.regression import single

        if not isinstance(policy, str):
            _require_conformance(policy, domain, min(episodes, 1000), horizon)
        task = single.task(
            policy,
            domain,
            episodes=episodes,
            seed=seed,
            horizon=horizon,
            engine=engine,
            max_episodes=max_episodes,
            how=how,
        )
        result = single.check(self._path(name), task, limits, exact=exact, renew=self._force)
        if result is not None:
            pytest.fail(result, pytrace=False)

    def _path(self, name: str | None) -> Path:
        __tracebackhide__ = True
        stem = re.sub(r"[^\w.-]+", "_", name or self._test)
        path = self._folder / f"{stem}.toml"
        if path in self._done:
            message = f"two checks of {self._test} share the name '{stem}': give them names (name=…)"
            pytest.fail(message, pytrace=False)
        self._done.add(path)
        return path


def _require_conformance(policy: Policy, domain: Domain | str, episodes: int, horizon: int) -> None:
    __tracebackhide__ = True
    from harness.play.conformance import ConformanceError, check_policy

    try:
        check_policy(policy, domain, episodes, horizon=horizon)
    except ConformanceError as error:
        pytest.fail(str(error), pytrace=False)
