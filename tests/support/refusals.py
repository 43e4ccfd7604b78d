"""What loading a configuration refuses."""

import pytest

from dronecombat_jax.config import settings
from dronecombat_jax.errors import EXIT_CONFIG, UserError


def errors_of(*args, **kwargs) -> list[str]:
    """The lines of the error that loading raises."""
    with pytest.raises(UserError) as caught:
        settings.load(*args, **kwargs)
    assert caught.value.exit_code == EXIT_CONFIG
    return caught.value.message.splitlines()
