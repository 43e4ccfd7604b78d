"""`python -m dronecombat_jax`, and the entry point of the command `dronecombat`.

TRAP: until `main` has settled what signals do, Python answers Ctrl-C with a traceback. Nothing that
takes time may be imported before that.
"""

import signal
import sys


def main() -> int:
    """Run the command that this process was started for."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # ends the process at once, without a traceback
    from dronecombat_jax.runs import signals

    with signals.ending_at_once():
        from dronecombat_jax.cli import commands as cli
        from dronecombat_jax.runs import lowered

        lowered.keep()
        return cli.main()


if __name__ == "__main__":
    sys.exit(main())
