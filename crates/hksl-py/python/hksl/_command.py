"""The command `hksl`."""

import signal
import sys

from . import _native


def main() -> int:
    """Runs the command line, which handles signals itself."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.run_command(sys.argv[1:], sys.argv[0])


if __name__ == "__main__":
    sys.exit(main())
