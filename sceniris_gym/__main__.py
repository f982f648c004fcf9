"""The program `sceniris-gym`. Signals end it at once, even during its imports."""

import atexit
import gc

from sceniris_gym.stopping import end_at_signals


def main() -> None:
    """Run the command line, see `cli.main`. As in a shell, Ctrl-C exits with status 130 and SIGTERM with 143."""
    end_at_signals()
    # the collections at the end of Python would visit the syntax trees of Warp's kernels, for a second or two
    atexit.register(gc.freeze)
    from sceniris_gym import cli

    cli.main()


if __name__ == "__main__":
    main()
