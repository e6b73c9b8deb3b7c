"""The ``harness`` command, and ``python -m harness``: Ctrl-C is one line and exit status 130, whenever it comes."""

import os
import signal
from types import FrameType


def main() -> int:
    """Run the command line of this process; the exit status."""
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else somebody wants it ignored
    if ours:
        signal.signal(signal.SIGINT, _interrupt)
    try:
        from harness.cli import main as run

        return run()
    except KeyboardInterrupt:  # once more, while the first one was answered
        return _interrupted()
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # what is left is Python's own tidying: no traceback of it


def _interrupt(_: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt; but while a module is being imported end at once: libraries swallow it there."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            os._exit(_interrupted())
        frame = frame.f_back
    raise KeyboardInterrupt


def _interrupted() -> int:
    os.write(2, b"harness: interrupted\n")
    return 130


if __name__ == "__main__":
    raise SystemExit(main())
