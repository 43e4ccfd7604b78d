"""`python -m dronecombat_jax` is `dronecombat`."""

import sys

from dronecombat_jax.cli import main

sys.exit(main())
