"""One self-contained HTML page of what was compared, evolved and tuned, with episodes to step through."""

from harness.report.writing import write_report

__all__ = ["write_report"]
