# MuJoCo ships no stubs, and what its C++ modules export is invisible to pyright.
from typing import Any

def __getattr__(name: str) -> Any: ...
