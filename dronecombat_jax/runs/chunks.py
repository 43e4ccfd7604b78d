"""`chunks.jsonl`: one JSON object per chunk and seed, written at the chunk's end.

A chunk is summed up from its iterations' records (`records`), so a run that was stopped inside a
chunk sums it up to the same numbers. The seconds are this process's own.
"""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from dronecombat_jax.config.fields import Config
from dronecombat_jax.files import metrics
from dronecombat_jax.files.metrics import MetricsWriter, Record
from dronecombat_jax.runs.records import AGAINST, ENDINGS
from dronecombat_jax.types import SIDES, Outcome, SelfPlay

SHARES = (
    *(f"outcome/{cause.name.lower()}" for cause in ENDINGS),
    *(f"win/{outcome.name.lower()}" for outcome in Outcome),
    *(f"crash/{role}" for role in SIDES),
)
MAX_MEMBERS, MIN_GAMES = 64, 0.5  # in a record: it must not grow with the pool
MEANS = ("kl", "entropy", "explained_variance")


class ChunkLog:
    """Collects what a chunk's iterations report and writes its summary; a context manager."""

    def __init__(self, config: Config, path: Path, metrics_path: Path, iteration: int):
        """`iteration`: done so far; inside a chunk its records are read back from `metrics_path`."""
        self._config = config
        self._rows: list[Record] = []
        if iteration % config.train.chunk_iterations and metrics_path.exists():
            chunk = iteration // config.train.chunk_iterations + 1
            self._rows = [row for row in metrics.read(metrics_path) if row.get("chunk") == chunk]
        self._writer = MetricsWriter(path)
        self._seconds = {"compile": 0.0, "program": 0.0, "saving": 0.0}
        self._added = 0  # records since the last summary
        # seconds of physics and rollout in an iteration of all seeds, once measured
        self.flight: float | None = None

    def __enter__(self) -> "ChunkLog":
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    @contextmanager
    def timed(self, what: str) -> Iterator[None]:
        """Count the block's seconds as compile, program or saving: since the last summary, or the
        process's start.
        """
        start = time.monotonic()
        yield
        self._seconds[what] += time.monotonic() - start

    def add(self, record: Record) -> None:
        """Take in the record of one iteration and seed."""
        self._rows.append(record)
        self._added += 1

    def write(self, selfplay: SelfPlay | None) -> None:
        """Sum up the chunk that has ended, to the disk; `selfplay` as at its end, NumPy leaves [S,
        ...].

        Seconds of all seeds together; rollout (physics and policies) and update are the program's,
        split by one measurement of flying alone. The save that follows counts with the next chunk:
        it must cover this record.
        """
        for index in range(self._config.train.num_seeds):
            seed = self._config.train.seed + index
            rows = [row for row in self._rows if row["seed"] == seed]
            seconds = {f"seconds/{what}": round(value, 3) for what, value in self._split().items()}
            self._writer.write(
                summary(rows) | met(self._config, selfplay, index, rows[-1]["chunk"]) | seconds
            )
        self._writer.sync()
        self._rows.clear()
        self._added = 0
        self._seconds = dict.fromkeys(self._seconds, 0.0)

    def _split(self) -> dict[str, float]:
        """The seconds, the program's split into flying (as measured once) and learning (the rest)."""
        if self.flight is None:
            return self._seconds
        program = self._seconds["program"]
        flown = min(self.flight * self._added / self._config.train.num_seeds, program)
        return {**self._seconds, "rollout": flown, "update": program - flown}


def summary(rows: list[Record]) -> Record:
    """A chunk of one seed from its iterations' records: shares of all its fights, means over what
    was learnt.
    """
    last, episodes = rows[-1], sum(row["episodes"] for row in rows)
    record = {key: last[key] for key in ("chunk", "iteration", "steps", "seed")}
    record |= {"iterations": len(rows), "episodes": episodes}
    steps = sum(row["episode_steps"] * row["episodes"] for row in rows if row["episodes"])
    record["episode_steps"] = steps / episodes if episodes else None
    for key in SHARES:  # counts come back exactly: a share times its total, to the next integer
        count = sum(
            round((row.get(key) or 0.0) * row["episodes"]) for row in rows if row["episodes"]
        )
        record[key] = count / episodes if episodes else None
    for key in last:
        if key.startswith(AGAINST):  # plain counts
            record[key] = sum(row.get(key) or 0 for row in rows)
    record["diverged"] = sum(row.get("diverged", 0) for row in rows)
    for role in SIDES:
        record[f"learning_rate/{role}"] = (_known(rows, f"learning_rate/{role}") or [None])[-1]
        for name in MEANS:
            values = _known(rows, f"{name}/{role}")
            record[f"{name}/{role}"] = math.fsum(values) / len(values) if values else None
    return record


def met(config: Config, selfplay: SelfPlay | None, seed_index: int, chunk: int) -> Record:
    """Who was met in a chunk (1, 2, ...), and how the live players have fared against each past one
    so far.

    `frozen`: the role that was played by its past; `opponent`: its slot, or the mean of the
    `opponents` different ones that the environments met; or the name of another opponent. `members/<role>`: slots of that role's
    past players that were met of late, at most 64 with the most games; `games/<role>`,
    `win_rate/<role>`: theirs. Old games fade (`selfplay.memory`), and the rate is shrunk towards
    1/2.
    """
    record: Record = {"frozen": None, "opponent": None, "opponents": 0}
    if selfplay is None:
        return record
    from dronecombat_jax.selfplay.pool import FIXED, chunk_rows, win_rates

    frozen, slots = int(selfplay.frozen[seed_index]), np.asarray(selfplay.opponent[seed_index])
    if frozen >= 0 and slots[0] < 0:  # no past player
        row = chunk_rows(config)[FIXED - int(slots[0])]
        record = {"frozen": SIDES[frozen], "opponent": row.name, "opponents": 1}
    elif frozen >= 0:
        whole_chunk = config.selfplay.scope == "chunk"
        record = {
            "frozen": SIDES[frozen],
            "opponent": int(slots[0]) if whole_chunk else float(slots.mean()),
            "opponents": len(np.unique(slots)),
        }
    for role, pool in zip(SIDES, selfplay.pools, strict=True):
        if pool is not None:  # a chunk's start fills one slot more, so `chunk` are filled
            rates, games = np.asarray(win_rates(pool)), np.asarray(pool.games)
            rates, games = rates[seed_index, :chunk], games[seed_index, :chunk]
            most = np.argsort(-games, kind="stable")[:MAX_MEMBERS]
            members = sorted(int(slot) for slot in most if games[slot] >= MIN_GAMES)
            record[f"members/{role}"] = members
            record[f"win_rate/{role}"] = [round(float(rates[slot]), 4) for slot in members]
            record[f"games/{role}"] = [round(float(games[slot]), 1) for slot in members]
    return record


def _known(rows: list[Record], key: str) -> list[float]:
    """The numbers that are known: an agent that does not learn reports none."""
    values = (row.get(key) for row in rows)
    return [value for value in values if value is not None and math.isfinite(value)]
