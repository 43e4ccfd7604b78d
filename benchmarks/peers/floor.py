"""The bound of two learners: this machine's 2048-cube float32 product over the 5.0 MFLOP of
products that a step takes.

python -m benchmarks.peers.floor      # asked for its turns on stdin, see `turns`
"""

import os

for variable in ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"):
    # a kernel chosen for another processor, where one is
    os.environ.pop(variable, None)

import numpy as np  # noqa: E402

from benchmarks.peers.turns import Turns  # noqa: E402

SIZE = 2048
# Four networks forward in the rollout, five epochs forward and backward without the input's
# gradient.
FLOP_PER_STEP = 5.0e6


def main() -> None:
    """Multiply for ever, in turns."""
    left = np.random.default_rng(0).standard_normal((SIZE, SIZE), dtype=np.float32)
    right, product = left.T.copy(), np.empty_like(left)
    turns = Turns(2 * SIZE**3 / FLOP_PER_STEP)
    while True:
        np.matmul(left, right, out=product)
        turns.done()


if __name__ == "__main__":
    main()
