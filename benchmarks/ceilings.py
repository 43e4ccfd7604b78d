"""What this machine could do at best: float32 matrix products by NumPy's BLAS and by XLA, and
memory bandwidth.

The products are a large cube, which is the ceiling, and those of the networks on a mini-batch:
forward, the gradient of the weights and that of the input, each as it stands in memory (transposed
operands are not copied first).
"""

import ctypes
import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.size import ACTION_SIZE, OBSERVATION_SIZE, Size
from benchmarks.worker import Part, Program

CUBE = "cube"
DIRECTIONS = ("forward", "input gradient", "weight gradient")
# floats: three blocks fit a core's second-level cache, so the second pass costs no memory traffic
TRIAD_BLOCK = 2**14


class Product(NamedTuple):
    """`left` [m, k] times `right` [k, n], each of them as it is or as a transposed view."""

    name: str
    left: np.ndarray
    right: np.ndarray

    @property
    def gflop(self) -> float:
        """Of one product."""
        return 2e-9 * self.left.shape[0] * self.left.shape[1] * self.right.shape[1]

    def repeats(self, size: Size) -> int:
        """Products in one timed block."""
        return max(2, math.ceil(size.product_gflop / self.gflop))


def products(size: Size) -> list[Product]:
    """The cube and the products of a policy network on a mini-batch; the first layer's input needs
    no gradient.
    """
    numbers = np.random.default_rng(0)
    draw = lambda *shape: numbers.standard_normal(shape, dtype=np.float32)
    made = [Product(CUBE, draw(size.cube, size.cube), draw(size.cube, size.cube))]
    for index, (rows, columns) in enumerate(
        pairwise((OBSERVATION_SIZE, *size.hidden_sizes, ACTION_SIZE))
    ):
        x, weight, output = (
            draw(size.minibatch, rows),
            draw(rows, columns),
            draw(size.minibatch, columns),
        )
        made.append(Product(f"{rows}x{columns} forward", x, weight))
        if index:
            made.append(Product(f"{rows}x{columns} input gradient", output, weight.T))
        made.append(Product(f"{rows}x{columns} weight gradient", x.T, output))
    return made


def numpy_products(size: Size) -> Part:
    """The products by NumPy's BLAS, in GFLOP/s."""

    def program(product: Product) -> Program:
        out, repeats = (
            np.empty((product.left.shape[0], product.right.shape[1]), np.float32),
            product.repeats(size),
        )

        def call() -> None:
            for _ in range(repeats):
                np.matmul(product.left, product.right, out=out)

        return Program(product.name, "GFLOP/s", repeats * product.gflop, call)

    return Part([program(product) for product in products(size)], facts={"blas": blas()})


def xla_products(size: Size) -> Part:
    """The products by XLA, each a jitted program that writes into the memory of the last result, in
    GFLOP/s.
    """
    from dronecombat_jax.machine import backend

    backend.prepare("cpu")

    def program(product: Product) -> Program:
        multiply, left, right = contraction(product)
        last = [
            multiply(
                left, right, np.zeros((product.left.shape[0], product.right.shape[1]), np.float32)
            )
        ]
        repeats = product.repeats(size)

        def call() -> None:
            for _ in range(repeats):
                last[0] = multiply(left, right, last[0])
            last[0].block_until_ready()

        return Program(product.name, "GFLOP/s", repeats * product.gflop, call)

    return Part([program(product) for product in products(size)])


def contraction(product: Product) -> tuple[Callable[..., Any], Any, Any]:
    """A jitted `multiply(left, right, out)` and both operands on the device, as they stand in
    memory.

    A transposed view is given as the array that it views, and contracted along its first axis.
    `out` gives its memory to the result: fresh pages for every product would be timed, too.
    """
    import jax

    turned = [side.base is not None for side in (product.left, product.right)]
    left, right = (
        jax.device_put(side.T if is_view else side)
        for side, is_view in zip((product.left, product.right), turned, strict=True)
    )
    axes = ((0,) if turned[0] else (1,), (1,) if turned[1] else (0,))
    multiply = jax.jit(
        lambda left, right, out: jax.lax.dot_general(left, right, (axes, ((), ()))),
        donate_argnums=2,
        keep_unused=True,
    )
    return multiply, left, right


def memory(size: Size) -> Part:
    """STREAM's triad a = b + s c in float32, with one thread and with one on each core, in GB/s.

    Three arrays count, as STREAM counts them (McCalpin, 1995): two are read and one is written.
    """
    cores = len(os.sched_getaffinity(0))
    a, b, c = (np.full(size.triad_floats, value, np.float32) for value in (0.0, 1.0, 2.0))
    blocks = [
        slice(start, start + TRIAD_BLOCK) for start in range(0, size.triad_floats, TRIAD_BLOCK)
    ]
    scale, pool = np.float32(3.0), ThreadPoolExecutor(cores)

    def sweep(mine: list[slice]) -> None:
        for block in mine:  # NumPy releases the interpreter's lock inside
            np.multiply(c[block], scale, out=a[block])
            np.add(a[block], b[block], out=a[block])

    def triad(threads: int) -> Callable[[], None]:
        share = -(-len(blocks) // threads)
        shares = [blocks[start : start + share] for start in range(0, len(blocks), share)]

        def call() -> None:
            for _ in range(size.triad_passes):
                list(pool.map(sweep, shares))

        return call

    work = 3 * 4e-9 * size.triad_floats * size.triad_passes
    return Part(
        [Program("triad-1", "GB/s", work, triad(1)), Program("triad", "GB/s", work, triad(cores))],
        facts={"threads": cores},
    )


def blas() -> str:
    """NumPy's BLAS and the kernel that it runs on this processor, such as "OpenBLAS 0.3.30, kernel
    SkylakeX".
    """
    for library in sorted((Path(np.__file__).parents[1] / "numpy.libs").glob("*openblas*")):
        loaded = ctypes.CDLL(str(library))  # the one that NumPy has loaded
        answers = []
        for question in ("config", "corename"):
            ask = getattr(loaded, f"scipy_openblas_get_{question}64_")
            ask.restype = ctypes.c_char_p
            answers.append(ask().decode().split())
        return f"{answers[0][0]} {answers[0][1]}, kernel {answers[1][0]}"
    return "unknown"
