"""`dronecombat doctor`; its checks are in `doctor`."""

from collections.abc import Sequence
from dataclasses import dataclass

from dronecombat_jax.config import flags
from dronecombat_jax.config.setting import setting


@dataclass(frozen=True)
class DoctorFlags:
    """Say what this machine has and what is missing, or how a drone's file is flown.

    Such as

        dronecombat doctor
        dronecombat doctor --mjcf my_drone.xml
    """

    mjcf: str = setting("", "an MJCF: how its drone is flown, side by side with C MuJoCo")


def doctor(args: Sequence[str]) -> int:
    """say what this machine has and what is missing"""
    given: DoctorFlags = flags.read(DoctorFlags, args, "dronecombat doctor")
    from dronecombat_jax.cli import doctor as examiner

    return examiner.doctor_mjcf(given.mjcf) if given.mjcf else examiner.doctor()
