"""Train, look at the run, and let its newest policies meet a scripted pilot."""

import dronecombat_jax as dc


def main(preset: str = "smoke") -> float:
    """The share of 64 fights in which the trained attacker gets past a hovering defender."""
    run = dc.train(preset, {"run.name": "from-python", "run.video": False})
    saved = dc.load_run(run)
    print(f"{run}: {saved.iteration} iterations of seeds from {saved.config.train.seed} on")

    from dronecombat_jax.runs.evaluation import Match, play, summary

    fights = play(saved, 0, Match(fights=64, defender="hover"))
    return summary(saved.config, fights)["win"]["attacker"][0]


if __name__ == "__main__":
    print(f"past hover: {main():.2f}")
