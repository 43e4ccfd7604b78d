"""The command line: `dronecombat COMMAND`. One function per command, one line in COMMANDS.

Commands read and check their flags before anything heavy is imported; JAX and MuJoCo are imported
by the rooms they call. A user's mistake is one line on stderr and an exit code (`errors`).
"""

import difflib
import os
import sys
from collections.abc import Callable, Sequence

from dronecombat_jax.cli.exploit import exploit
from dronecombat_jax.cli.inventory import runs
from dronecombat_jax.cli.machine import doctor
from dronecombat_jax.cli.pilots import pilots
from dronecombat_jax.cli.play import play
from dronecombat_jax.cli.rate import rate
from dronecombat_jax.cli.replay import replay
from dronecombat_jax.cli.reproduce import reproduce
from dronecombat_jax.cli.robustness import robustness
from dronecombat_jax.cli.runs import evaluate, export
from dronecombat_jax.cli.tournaments import compare, report, tournament
from dronecombat_jax.cli.train import train
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import UserError

EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141

COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train,
    "evaluate": evaluate,
    "export": export,
    "exploit": exploit,
    "tournament": tournament,
    "report": report,
    "compare": compare,
    "robustness": robustness,
    "reproduce": reproduce,
    "replay": replay,
    "pilots": pilots,
    "rate": rate,
    "play": play,
    "runs": runs,
    "doctor": doctor,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; the entry point of `dronecombat`."""
    args = list(sys.argv[1:] if argv is None else argv)
    try:
        return _run(args)
    except UserError as error:
        for line in error.message.splitlines():
            print(f"error: {line}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader has gone: `dronecombat train --help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return EXIT_BROKEN_PIPE


def usage() -> str:
    """What `dronecombat --help` prints."""
    lines = [
        f"  {name:<10} {(command.__doc__ or '').splitlines()[0]}"
        for name, command in COMMANDS.items()
    ]
    return "\n".join(
        [
            "usage: dronecombat COMMAND [flags]",
            "",
            *lines,
            "",
            "dronecombat COMMAND --help explains the flags.",
        ]
    )


def _run(args: list[str]) -> int:
    if not args or args[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if args else 2
    name = args[0]
    if name not in COMMANDS:
        close = difflib.get_close_matches(name, COMMANDS, n=1)
        hint = f"did you mean {close[0]}?" if close else f"commands: {', '.join(COMMANDS)}"
        raise UserError(f"{one_line(name)}: unknown command; {hint}")
    try:
        return COMMANDS[name](args[1:])
    except SystemExit as stop:  # argparse, after --help
        if stop.code:
            raise
        return 0


if __name__ == "__main__":
    from dronecombat_jax import __main__ as program

    sys.exit(program.main())
