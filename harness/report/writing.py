"""``harness.write_report``: from files to a page."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from datetime import date, datetime, timezone
from pathlib import Path

from harness import files
from harness.errors import HarnessError, check_whole, quoted
from harness.model.domain import Domain
from harness.report import comparing, evolving, inputs, records, tuned
from harness.report.inputs import Input, Sweep, Table, Tuning
from harness.report.page import Section, page
from harness.report.replays import Domains, Wanted, replays

EPISODES = 3
MOST_EPISODES = 1_000
"""Of each policy, at most: a page holds them all."""


def write_report(
    sources: Sequence[str | Path] | str | Path,
    out: str | Path,
    *,
    episodes: int = EPISODES,
    seed: int | None = None,
    domains: Sequence[Domain | str] = (),
    allow_code: bool = False,
    made: date | None = None,
) -> Path:
    """Write ``index.html``, one page that needs no other file and no network, from results on disk.

    Args:
        sources: comparison tables (CSV or JSON of ``harness compare``), folders of ``harness evolve``, ``tune`` and
            ``sweep``, in any number; or one of them.
        out: the folder for the page.
        episodes: of each policy to be replayed, the first so many of a seed; 0 for none.
        seed: of the episodes; by default those that a table is of, and seed 0 for the winners of runs.
        domains: domains that do not ship with the package (objects, snapshots, Julia files), for their replays.
        allow_code: read and run the files that the results name as domains and policies, for their replays.
        made: the day that the page says it was made on; by default that of the environment's ``SOURCE_DATE_EPOCH``
            (seconds since 1970), else today's (UTC).

    Returns:
        The path of the page. The same inputs give the same bytes on the same day.

    Raises:
        HarnessError: there is no such input, one is of no known kind or damaged, or the page cannot be written.
    """
    check_whole("episodes", episodes, 0, MOST_EPISODES)
    if seed is not None:
        check_whole("seed", seed, 0, 2**64 - 1)
    paths = [files.named(each) for each in ([sources] if isinstance(sources, str | Path) else sources)]
    path = files.named(out) / "index.html"
    if not paths:
        raise HarnessError(f"a report needs something to report on: {records.EXPECTED}")
    found = [each for path in paths for each in inputs.read(path)]
    made = made or _today()
    known = Domains(domains, allow_code)
    sections = [_section(each, known, episodes, seed) for each in found]
    files.replace_text(path, page("POMDP benchmark report", made, sections))
    return path


def _today() -> date:
    """Now, or the time that whoever builds reproducibly has set (reproducible-builds.org)."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    try:
        return datetime.fromtimestamp(time.time() if epoch is None else int(epoch), timezone.utc).date()
    except (ValueError, OverflowError, OSError):
        raise HarnessError(f"SOURCE_DATE_EPOCH must be seconds since 1970, not {quoted(epoch)}") from None


def _section(found: Input, domains: Domains, episodes: int, seed: int | None) -> Section:
    title, body, wanted = _parts(found, seed)
    return Section(title, found.name, body, *replays(wanted, domains, episodes))


def _parts(found: Input, seed: int | None) -> tuple[str, str, list[Wanted]]:
    """Heading, HTML, and the policies to be replayed."""
    if isinstance(found, inputs.Domains):
        return comparing.DOMAINS, comparing.domains_body(found), []
    if isinstance(found, Table):
        return comparing.title(found), comparing.body(found), comparing.wanted(found, seed)
    if isinstance(found, Tuning):
        return tuned.title(found), tuned.body(found), tuned.wanted(found, seed)
    if isinstance(found, Sweep):
        return tuned.sweep_title(found), tuned.sweep_body(found), []
    return evolving.title(found), evolving.body(found), evolving.wanted(found, seed)
