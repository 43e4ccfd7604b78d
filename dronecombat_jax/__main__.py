"""`python -m dronecombat_jax`, and the entry point of the command `dronecombat`."""

import sys

from dronecombat_jax import cli
from dronecombat_jax.runs import lowered


def main() -> int:
    """Run the command that this process was started for."""
    lowered.keep()
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
