"""Errors that a user can cause: one clear line and an exit code, never a traceback."""

EXIT_CONFIG = 2
EXIT_DATA = 3
EXIT_DIVERGED = 4
EXIT_TOURNAMENT = 5
EXIT_CANNOT_WRITE = 73
EXIT_STOPPED = 75


class UserError(Exception):
    """A mistake in the input: `message` names the file, the key, the value and what is allowed."""

    def __init__(self, message: str, exit_code: int = EXIT_CONFIG):
        super().__init__(message)
        self.message = message
        self.exit_code = exit_code
