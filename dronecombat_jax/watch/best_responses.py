"""The whole of `dronecombat exploit`: train the responders, let them fight, draw how far they got.

What does not live here: their settings (`runs.responders`), their fights (`runs.exploit`).
"""

from typing import Any

from dronecombat_jax.runs.responders import Plan


def respond(planned: Plan) -> tuple[int, dict[str, Any]]:
    """Train, then let the responders fight and write the result; returns the exit code of the
    training and the result, once there is one.

    JAX must be prepared. Raises UserError: 2 and 3 for who cannot be met, what a training raises.
    """
    from dronecombat_jax.runs import exploit, training

    exploit.write_policy(planned)
    if code := training.train(planned.config):
        return code, {}
    result = exploit.exploit(planned)
    from dronecombat_jax.report.exploit_figure import exploit_curve
    from dronecombat_jax.report.figures import save_figure

    picture = planned.result.with_suffix(".png")
    save_figure(exploit_curve(result), picture)
    print(exploit.line(result))
    print(f"written to {planned.result} and {picture}", flush=True)
    return 0, result
