"""A check told to people: the table, the sentences, and what an update moved."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from tabulate import tabulate

from harness.regression.checking import Move
from harness.regression.judging import Outcome, ScoreCheck
from harness.regression.rows import AnyScore, Limits, StoredExact
from harness.regression.statistics import DROP, FALSE_ALARM, MIN_EFFECT

_DOUBTFUL = 0.05  # as large as error rates are anywhere
HEADERS = ("domain", "policy", "stored", "now", "change", "p", "catches", "level", "verdict")


def text(check: ScoreCheck) -> str:
    """The table, a sentence for every row that needs one, and the count of verdicts."""
    needy = [o for o in check.outcomes if not o.passed or o.verdict in ("changed", "better")]
    notes = "".join(f"\n{check.path}:{o.line}: {sentence(o)}" for o in needy)
    return f"{table(check.outcomes, 'simple')}\n{notes}\n\n{footnote(check)}\n".replace("\n\n\n", "\n\n")


def table(outcomes: Sequence[Outcome], style: str) -> str:
    """The outcomes in a format of tabulate's."""
    lines = [
        [
            o.row.domain,
            o.row.policy,
            _mean(o.stored),
            _mean(o.fresh),
            "" if o.change is None else f"{o.change:+.2f}" if o.change else "0",
            "" if o.level != "statistical" else f"{o.p:.2g}",
            "" if o.smallest_drop is None else f"{o.smallest_drop:.2f}",
            o.level,
            o.verdict if o.passed else o.verdict.upper(),
        ]
        for o in outcomes
    ]
    align = ("left", "left", *["right"] * 5, "left", "left")
    return tabulate(lines, headers=HEADERS, tablefmt=style, colalign=align if lines else None, disable_numparse=True)


def footnote(check: ScoreCheck) -> str:
    """The count of verdicts, and how far they can be trusted."""
    counts = Counter(o.verdict for o in check.outcomes)
    limits = check.limits
    counted = ", ".join(f"{number} {verdict}" for verdict, number in counts.items())
    return (
        f"{len(check.outcomes)} row{'s' * (len(check.outcomes) != 1)}: {counted}.\n"
        f"p: Welch's one-sided test of a drop by more than {limits.min_effect:g}, Holm-corrected over the rows. Worse: "
        f"p ≤ {limits.false_alarm:g}, so that\nunchanged code fails at most once in {1 / limits.false_alarm:,.0f} "
        f"checks. catches: the smallest true drop that a test finds with probability\n{limits.power:g} "
        f"(empty where all returns are equal: any drop of them all is found)."
        + "".join(f"\n{word}" for word in [*_words(limits), *_on_exact(check)])
    )


def _words(limits: Limits) -> list[str]:
    """A word on limits with which a check says little."""
    alarm, effect = limits.false_alarm, limits.min_effect
    words = {
        f"false_alarm = {alarm:.10g} is large: a failure says little; {FALSE_ALARM:g} is usual.": alarm > _DOUBTFUL,
        f"min_effect = {effect:g} is large: a row may lose so much and pass; {MIN_EFFECT:g} is usual.": effect > DROP,
    }
    return [word for word, needed in words.items() if needed]


def _on_exact(check: ScoreCheck) -> list[str]:
    if not any(isinstance(o.stored, StoredExact) for o in check.outcomes):
        return []
    return ["Without ±: expected returns, computed; they differ when more than rounding tells them apart."]


def sentence(o: Outcome) -> str:
    """What became of a row, with its numbers, in one sentence."""
    who = f"{o.row.policy} on {o.row.domain}"
    if o.stored is None or o.fresh is None or o.change is None:
        return f"{who}: {o.reason}"
    moved = (
        f"{_mean(o.stored)} → {_mean(o.fresh)} {_rests_on(o.fresh, 'over ')} "
        f"(discounted {_pair(o.stored.discounted_mean, o.fresh.discounted_mean, '.2f')}, "
        f"steps {_pair(o.stored.steps_mean, o.fresh.steps_mean, '.1f')}, "
        f"success {_pair(o.stored.success_rate, o.fresh.success_rate, '.1%')})"
    )
    if o.verdict == "worse":
        test = f", p = {o.p:.2g}" if o.level == "statistical" else ""
        return f"{who} got worse by {-o.change:.3g}{test}: {moved}"
    if o.verdict == "better":
        return f"{who} got better by {o.change:.3g}: {moved}; keep it with harness check --update"
    if isinstance(o.stored, StoredExact):
        return f"{who}: its expected return is another: {moved}"
    if o.verdict == "differs" and (o.row.seed, o.row.episodes) != (o.stored.seed, o.stored.episodes):
        return (
            f"{who} cannot be compared exactly: the row says {o.row.episodes:,} episodes of seed {o.row.seed}, "
            f"stored are {o.stored.episodes:,} of seed {o.stored.seed}; run harness check --update"
        )
    ending = "" if o.verdict == "same" else f" (p = {o.p:.2g}: not worse)"
    which = "the same episodes came out differently" if o.verdict in ("changed", "differs") else "other episodes"
    return f"{who}: {which}{ending}: {moved}"


def moves(changes: Sequence[Move]) -> str:
    """What an update wrote: old → new, with the difference in standard errors."""
    lines = [_move(change) for change in changes if change.before != change.after]
    kept = len(changes) - len(lines)
    return "\n".join([*lines, f"{len(lines)} moved, {kept} as before"]) + "\n"


def _move(change: Move) -> str:
    old, new = change.before, change.after
    score = new or old
    assert score is not None  # a move has at least one side
    who = f"{score.policy} on {score.domain}"
    if new is None:
        return f"{who}: {_mean(old)} dropped, no longer listed"
    if old is None:
        return f"{who}: {_mean(new)} stored, {_rests_on(new)}"
    if (old.domain_version, old.model_hash) != (new.domain_version, new.model_hash):
        return f"{who}: {_mean(old)} → {_mean(new)}, on another model of the domain: not comparable"
    error = math.hypot(old.sem, new.sem)
    difference = new.mean - old.mean
    size = f"{difference / error:+.1f} standard errors" if error else f"{difference:+g} exactly"
    return f"{who}: {_mean(old)} → {_mean(new)} ({size})"


def _mean(score: AnyScore | None) -> str:
    return "" if score is None else score.text


def _rests_on(score: AnyScore, before: str = "") -> str:
    return "as computed" if isinstance(score, StoredExact) else f"{before}{score.reference_episodes:,} episodes"


def _pair(old: float, new: float, form: str) -> str:
    return f"{old:{form}} → {new:{form}}"
