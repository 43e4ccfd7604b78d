"""A file of settings for a test."""

from pathlib import Path

import pytest


@pytest.fixture
def toml(tmp_path):
    """Writes a file and gives its path."""

    def write(content: str | bytes) -> Path:
        path = tmp_path / "own.toml"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write
