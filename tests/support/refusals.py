"""What a command and the loading of a configuration refuse."""

import pytest

from dronecombat_jax.cli import commands
from dronecombat_jax.config import settings
from dronecombat_jax.errors import EXIT_CONFIG, UserError


def errors_of(*args, **kwargs) -> list[str]:
    """The lines of the error that loading raises."""
    with pytest.raises(UserError) as caught:
        settings.load(*args, **kwargs)
    assert caught.value.exit_code == EXIT_CONFIG
    return caught.value.message.splitlines()


def refused(capsys, *args: str, code: int = EXIT_CONFIG) -> list[str]:
    """The lines on stderr of a command that is refused; each is an error, and stdout stays empty."""
    assert commands.main(args) == code
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert out == "" and lines and all(line.startswith("error: ") for line in lines)
    return [line.removeprefix("error: ") for line in lines]
