"""Who sits in a side's place in training: the table of opponents, read from the settings.

Each row gives one side's place to somebody who does not learn, in a share of the environments or of
the chunks; in all others both sides are live and learn from each other. What does not live here:
who is drawn and how they fly (`selfplay`), reading policies (`runs.opponents`). Nothing imports
JAX.
"""

import re
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from dronecombat_jax.config.fields import Config

DEFENDER, ATTACKER = 0, 1  # as in `types`, which needs JAX
SIDES = ("defender", "attacker")
LIVE = "live"  # both sides learn
PAST = "past"
NOBODY = "nobody"
SCRIPTED = "scripted:"
SHAPE = "SIDE=WHO SHARE, ..., such as attacker=past 0.3, defender=scripted:hover_guard 0.1"
_SPLIT = re.compile(r",\s*(?=(?:defender|attacker)=)")
_ROW = re.compile(r"(defender|attacker)=(\S|\S.*?\S)(?:\s+(\d+(?:\.\d*)?|\.\d+)( of chunks)?)?")
_EXACT = 1e-9  # sums of shares in binary


class Row(NamedTuple):
    """One opponent: in `share` of the environments, or of the chunks, `who` sits in `side`'s place."""

    side: int  # DEFENDER or ATTACKER; the other side learns
    who: str  # past, past:SAMPLER, nobody, scripted:NAME, or what names one policy
    share: float | None  # from 0 to 1; None: all that is left
    of_chunks: bool = (
        False  # drawn for whole chunks; else a share of the environments in all chunks
    )

    @property
    def name(self) -> str:
        """The row in short, such as `defender=scripted:hover`."""
        return f"{SIDES[self.side]}={self.who}"

    @property
    def past(self) -> bool:
        """Whether the opponent is drawn from the pool of past players."""
        return self.who == PAST or self.who.startswith(f"{PAST}:")

    @property
    def sampler(self) -> str:
        """The sampler that a past player is drawn by; "": `selfplay.sampler`."""
        return self.who.partition(":")[2] if self.past else ""

    @property
    def scripted(self) -> str:
        """The scripted pilot's name; "" for others."""
        return self.who.removeprefix(SCRIPTED) if self.who.startswith(SCRIPTED) else ""

    @property
    def policy(self) -> str:
        """What names a policy: a file, pilots:NAME, RUN or RUN:CHUNK; "" for others."""
        return "" if self.past or self.scripted or self.who == NOBODY else self.who


def parse(text: str) -> tuple[Row, ...]:
    """The rows that `selfplay.opponents` spells. ValueError, one line, where it is misspelt."""
    rows = []
    for part in _SPLIT.split(text.strip()) if text.strip() else ():
        match = _ROW.fullmatch(part.strip())
        if match is None:
            raise ValueError(f"{part.strip()!r} is not {SHAPE}")
        side, who, share, of_chunks = match.groups()
        rows.append(
            Row(SIDES.index(side), who, None if share is None else float(share), bool(of_chunks))
        )
    _check(rows)
    return tuple(rows)


def _check(rows: list[Row]) -> None:
    names = [row.name for row in rows]
    if double := next((name for name in names if names.count(name) > 1), ""):
        raise ValueError(f"{double} is named twice; add up its shares")
    for row in rows:
        first, *more = row.who.split()
        if first == LIVE or (more and first.startswith((PAST, NOBODY, SCRIPTED))):
            raise ValueError(f"{row.name!r} is not {SHAPE}")
        if row.share is not None and not 0.0 < row.share <= 1.0:
            raise ValueError(f"the share of {row.name} must be above 0, at most 1: {row.share:g}")
        if row.who == NOBODY and (row.side == ATTACKER or row.of_chunks or row.share is None):
            raise ValueError(
                f"{row.name}: only defender=nobody SHARE, a share of the environments, can be flown"
            )
    if sum(row.share is None for row in rows) > 1:
        raise ValueError(
            "one row alone may leave its share out: it takes all environments that are left"
        )
    others = [row for row in rows if row.who != NOBODY]
    drawn = [row.side for row in rows if row.past and row.of_chunks]
    if len(set(drawn)) < len(drawn):
        raise ValueError("a side's past is drawn for whole chunks by one sampler alone")
    if len({row.of_chunks for row in others}) > 1:
        raise ValueError("shares must be all of environments or all of chunks")
    for what in (True, False):
        total = sum(row.share or 0.0 for row in rows if row.of_chunks is what)
        if total > 1.0 + _EXACT:
            raise ValueError(f"the shares add up to {total:g}: at most 1")


@lru_cache(maxsize=64)
def _given(text: str) -> tuple[Row, ...]:
    return parse(text)


def table(config: "Config") -> tuple[Row, ...]:
    """All rows of a run, also those that older settings spell; shares as numbers.

    `train.solo_share` is a row of nobody, `selfplay.probability` one of past players (two where
    either side meets the past of the other). Nobody's row comes first, then the defender's, then
    the attacker's: environments are given out in this order, the live ones between the last two.
    A row that takes all that is left of the attacker's places leaves nobody to fly alone.
    """
    given = list(_given(config.selfplay.opponents))
    open_rows = [row for row in given if row.share is None]
    alone = config.train.solo_share
    if open_rows and open_rows[0].side == ATTACKER:
        alone, given = 0.0, [row for row in given if row.who != NOBODY]
    if alone > 0.0:
        given.insert(0, Row(DEFENDER, NOBODY, alone))
    left = 1.0 - sum(row.share or 0.0 for row in given if not row.of_chunks)
    given = [row._replace(share=left) if row.share is None else row for row in given]
    given += past_rows(config)
    return tuple(sorted(given, key=lambda row: (row.who != NOBODY, row.side)))


def past_rows(config: "Config") -> list[Row]:
    """What `selfplay.probability` and `selfplay.roles` say, as rows: the paper's S-IPPO."""
    selfplay = config.selfplay
    if selfplay.probability == 0.0:
        return []
    sides = {"defender": (ATTACKER,), "attacker": (DEFENDER,), "both": (DEFENDER, ATTACKER)}[
        selfplay.roles
    ]
    return [Row(side, PAST, selfplay.probability / len(sides), True) for side in sides]


class Places(NamedTuple):
    """Environments `first`, ..., `stop` - 1 and the row that is flown there; None: both are live."""

    row: Row | None
    first: int
    stop: int


def places(config: "Config") -> tuple[Places, ...]:
    """Who flies in which environments in every chunk; those of chunks are not in here."""
    rows = [row for row in table(config) if not row.of_chunks]
    attackers = [row for row in rows if row.side == ATTACKER]
    envs, given, taken, first = config.train.num_envs, [], 0.0, 0
    for row in rows[: len(rows) - len(attackers)]:
        taken += row.share or 0.0
        given.append(Places(row, first, stop := round(taken * envs)))
        first = stop
    behind, stop = [], envs
    taken = 0.0
    for row in reversed(attackers):
        taken += row.share or 0.0
        start = max(envs - round(taken * envs), first)
        behind.insert(0, Places(row, start, stop))
        stop = start
    live = [Places(None, first, stop)] if stop > first else []
    return (*given, *live, *behind)


def live_part(config: "Config", side: int) -> slice:
    """The environments in which `side` is live, and learns; empty where it is live in none."""
    taken = [place for place in places(config) if place.row is not None and place.row.side == side]
    stops = [place.stop for place in taken]
    if side == DEFENDER:
        return slice(max(stops, default=0), config.train.num_envs)
    return slice(0, min((place.first for place in taken), default=config.train.num_envs))


def strike_margins(config: "Config") -> tuple[float, ...]:
    """Metres that are added to the intercept radius of each environment: minus `train.strike_margin` where
    the defender alone learns, 0 elsewhere and in chunks of past players; none where that is 0.
    """
    margin, envs = config.train.strike_margin, config.train.num_envs
    if not margin:
        return ()
    with_attacker = live_part(config, ATTACKER).stop  # in all others somebody sits in its place
    return (0.0,) * with_attacker + (-margin,) * (envs - with_attacker)


def learns(config: "Config", side: int) -> bool:
    """Whether `side` is live anywhere."""
    part = live_part(config, side)
    return part.start < part.stop


def stands_for(config: "Config", side: int) -> Row | None:
    """Who sits in the place of a side that never learns: the row of most environments; else None."""
    if learns(config, side):
        return None
    rows = [row for row in table(config) if row.side == side and row.who != NOBODY]
    return max(rows, key=lambda row: row.share or 0.0, default=None)


def method(config: "Config") -> str:
    """How the run trains, for tables: "ippo"; "s-ippo" with past players; "opponents" with others."""
    rows = [row for row in table(config) if row.who != NOBODY]
    if not rows:
        return "ippo"
    return "s-ippo" if all(row.past for row in rows) else "opponents"


def described(config: "Config") -> list[str]:
    """The table as lines for people; empty where both sides are live everywhere and always."""
    lines = []
    for row in table(config):
        of = "chunks" if row.of_chunks else "environments"
        lines.append(f"{row.name}: {row.share:.3g} of the {of}")
    if config.head_start_chunks:
        lines.append(f"defender=itself, untrained: the first {config.head_start_chunks} chunks")
    return lines
