"""The program `sceniris-gym`. Signals end it at once, also during its imports."""

from __future__ import annotations

from sceniris_gym.stopping import end_at_signals


def main() -> None:
    """Run the command line; see `cli.main`. Ctrl-C ends it with status 130 and SIGTERM with 143, as in a shell."""
    end_at_signals("sceniris-gym")
    from sceniris_gym import cli

    cli.main()


if __name__ == "__main__":
    main()
