"""`dronecombat pilots`: who comes with the package."""

from collections.abc import Sequence
from dataclasses import dataclass

from dronecombat_jax.config import flags
from dronecombat_jax.config.setting import setting


@dataclass(frozen=True)
class PilotsFlags:
    """List the pilots that come with the package, and how they rate.

    Each is named pilots:NAME wherever a run or a policy file is. Without its number a name is the
    newest of its kind. Such as

        dronecombat pilots
        dronecombat pilots ippo-attacker
        dronecombat replay pilots:ippo-attacker --defender hover_guard
    """

    name: str = setting("", "one pilot; without it all of them")


def pilots(args: Sequence[str]) -> int:
    """the pilots that come with the package, and how they rate"""
    given: PilotsFlags = flags.read(PilotsFlags, args, "dronecombat pilots", positional="name")
    from dronecombat_jax.policies import shipped

    chosen = [path.stem for path in shipped.paths(given.name or shipped.ALL)]
    cards = shipped.cards()
    print(f"{'pilot':<22} {'steps':>7}  rating    95 %          loses to (share won)")
    for name in chosen:
        card = cards[name]
        interval = f"[{card.low:.0f}, {card.high:.0f}]"
        worst = ", ".join(card.loses_to) or "nobody"
        print(f"{name:<22} {card.steps / 1e6:5.1f} M  {card.rating:6.0f}  {interval:<13} {worst}")
    trained = dict.fromkeys(cards[name].trained for name in chosen)
    print(
        f"trained by: {', '.join(trained)}; the mean of all these and the scripted pilots is 1500"
    )
    return 0
