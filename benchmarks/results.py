"""From the rates of every round to what is reported: spreads, floors, ratios, the split of an
iteration.

Every ratio is taken within a round. What a round lacks (parts that were left out) is left out here.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

from benchmarks.ceilings import CUBE
from benchmarks.record import summary
from benchmarks.size import ACTION_SIZE, OBSERVATION_SIZE, Size, mflop_per_step

Rates = dict[str, float]  # of one round, by "part/program"

NOMINAL_GFLOPS = 150.0  # the matrix-product rate of the machine for which the targets were set
PIECES = ("physics", "policy", "learning")
# the paper's S-IPPO: the share of chunks in which the defender meets a past attacker
SELFPLAY_PROBABILITY = 0.2


class Target(NamedTuple):
    """A figure of one round, and what it should reach at least (None: only reported)."""

    name: str
    value: Callable[[Rates, Size], float]
    least: float | None = None


def gflops(rates: Rates) -> float:
    """The ceiling: the faster of NumPy's BLAS and XLA on the cube, all cores, GFLOP/s."""
    return max(rates[f"numpy/{CUBE}"], rates[f"xla/{CUBE}"])


def floor(rates: Rates, size: Size) -> float:
    """Steps/s of IPPO if its matrix products took all the time and ran at the ceiling."""
    return 1000.0 * gflops(rates) / mflop_per_step(size)


def shape_floor(rates: Rates, size: Size, part: str) -> float:
    """The same with every product at the rate that `part` ("numpy", "xla") measured for its own
    shape on a mini-batch.

    The value's last column and the policy's four are taken at the rate of the latter.
    """
    seconds = 0.0
    widths = (OBSERVATION_SIZE, *size.hidden_sizes, ACTION_SIZE)
    for index, (rows, columns) in enumerate(pairwise(widths)):
        # Of both agents: policy and value share all shapes but the last, 4 columns and 1.
        outputs = 2 * (ACTION_SIZE + 1) if index == len(widths) - 2 else 4 * columns
        gflop = 2e-9 * rows * outputs
        times = {"forward": 1 + size.epochs, "weight gradient": size.epochs}
        if index:
            times["input gradient"] = size.epochs
        seconds += sum(
            gflop * count / rates[f"{part}/{rows}x{columns} {name}"]
            for name, count in times.items()
        )
    return 1.0 / seconds


def mixed(rates: Rates) -> float:
    """Steps/s of the paper's S-IPPO: its chunks are frozen with a probability, live otherwise."""
    p = SELFPLAY_PROBABILITY
    return 1.0 / ((1.0 - p) / rates["sippo/live"] + p / rates["sippo/frozen"])


TRAINED, STEPPED = "ippo-seeds/iteration", "step-cores/environment"
TARGETS = (
    Target("IPPO, two seeds: steps/s", lambda r, s: r[TRAINED], 20_000),
    Target(
        "IPPO, two seeds: share of the matmul floor", lambda r, s: r[TRAINED] / floor(r, s), 0.65
    ),
    Target(
        "the same of the floor at the networks' shapes (XLA)",
        lambda r, s: r[TRAINED] / shape_floor(r, s, "xla"),
    ),
    Target(
        "IPPO, two seeds, scaled to 150 GFLOP/s: steps/s",
        lambda r, s: r[TRAINED] * NOMINAL_GFLOPS / gflops(r),
        20_000,
    ),
    Target("environment alone: steps/s", lambda r, s: r[STEPPED], 350_000),
    Target(
        "environment / plain mjx.Data, one program",
        lambda r, s: r[STEPPED] / r["step/plain data"],
        4.0,
    ),
    Target(
        "environment / plain mjx.Data, a device per core",
        lambda r, s: r[STEPPED] / r["step-cores/plain data"],
    ),
    Target(
        "environment / mujoco.rollout, lean model", lambda r, s: r[STEPPED] / r["mujoco/lean"], 1.5
    ),
    Target(
        "environment / mujoco.rollout, full model", lambda r, s: r[STEPPED] / r["mujoco/full"], 1.5
    ),
    Target(
        "physics alone / mujoco.rollout, lean model",
        lambda r, s: r["step-cores/physics"] / r["mujoco/lean"],
    ),
)
START_TARGETS = {"cold": 30.0, "warm": 8.0}  # seconds to the first line of training, at most


def derive(record: dict[str, Any]) -> dict[str, Any]:
    """`rates`, `floors`, `ratios` and `split` of a record, every figure with its spread over the
    rounds.
    """
    rounds, fields = record["rounds"], record["size"]
    size = Size(**{**fields, "hidden_sizes": tuple(fields["hidden_sizes"])})
    if not rounds:
        return {"rates": {}, "floors": {}, "ratios": {}, "split": {}}
    values = {name: summary([rates[name] for rates in rounds]) for name in rounds[0]}
    values |= _known(rounds, {"sippo/mixed": mixed})
    floors = {
        "matmul": lambda r: floor(r, size),
        "shapes, numpy": lambda r: shape_floor(r, size, "numpy"),
        "shapes, xla": lambda r: shape_floor(r, size, "xla"),
    }
    ratios = {}
    for name, value, least in TARGETS:
        spreads = _known(rounds, {name: lambda r, value=value: value(r, size)})
        ratios |= {key: {"least": least, **spread} for key, spread in spreads.items()}
    return {
        "rates": values,
        "floors": _known(rounds, floors),
        "ratios": ratios,
        "split": _splits(record),
    }


def _known(rounds: list[Rates], figures: dict[str, Callable[[Rates], float]]) -> dict[str, Any]:
    """The spread of every figure for which all parts were measured."""
    spreads = {}
    for name, value in figures.items():
        try:
            spreads[name] = summary([value(rates) for rates in rounds])
        except KeyError:
            continue
    return spreads


def _splits(record: dict[str, Any]) -> dict[str, Any]:
    """Milliseconds of an iteration and its pieces, by part; the rest is what the pieces leave,
    round by round.
    """
    return {
        part: _split(record, part) for part in ("ippo", "ippo-seeds") if part in record["parts"]
    }


def _split(record: dict[str, Any], part: str) -> dict[str, Any]:
    work = record["parts"][part]["work"]["iteration"]

    def milliseconds(rates: Rates, name: str) -> float:
        return 1000.0 * work / rates[f"{part}/{name}"]

    figures: dict[str, Callable[[Rates], float]] = {
        name: partial(milliseconds, name=name) for name in ("iteration", "flight", *PIECES)
    }
    figures["rest"] = lambda rates: (
        figures["iteration"](rates) - sum(figures[name](rates) for name in PIECES)
    )
    return _known(record["rounds"], figures)
