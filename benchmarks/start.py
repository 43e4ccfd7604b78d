"""How long a person waits for the first line of training: the real command, with an empty compile
cache and a warm one.

python -m benchmarks.start [--preset duel]
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.patience import Listener
from benchmarks.worker import ROOT, end_tidily

RUN = "start"
COMPILED = re.compile(r"compiled .* in ([0-9.]+) s")


def starts(preset: str = "duel", flags: tuple[str, ...] = ()) -> dict[str, dict[str, float]]:
    """Seconds of a cold and a warm start of `dronecombat train`, see `first_line`."""
    with tempfile.TemporaryDirectory(prefix="dronecombat-bench-") as folder:
        return {
            kind: first_line(preset, Path(folder) / "cache", Path(folder) / kind, flags)
            for kind in ("cold", "warm")
        }


def first_line(
    preset: str, cache: Path, runs: Path, flags: tuple[str, ...] = ()
) -> dict[str, float]:
    """Start a training, wait for the first line that shows progress, and end it.

    Seconds since the command was given until it compiles, has compiled, and shows its first line;
    the compilation itself as the command reports it. RuntimeError where training ends before it has
    shown anything; `patience.Hung` where it hangs.
    """
    command = [sys.executable, "-m", "dronecombat_jax", "train", "--preset", preset, "--name", RUN]
    command += [
        "--run.directory",
        str(runs),
        "--run.no-video",
        "--run.no-replay",
        "--run.no-figures",
        *flags,
    ]
    ours = {key: value for key, value in os.environ.items() if key != "JAX_COMPILATION_CACHE_DIR"}
    ours |= {"DRONECOMBAT_CACHE": str(cache), "PYTHONUNBUFFERED": "1"}
    begun, seconds = time.monotonic(), {}
    with (
        tempfile.TemporaryFile("w+") as stderr,
        subprocess.Popen(
            command, cwd=ROOT, env=ours, stdout=subprocess.PIPE, stderr=stderr, text=True
        ) as process,
    ):
        listener = Listener(process, "the start of training")
        try:
            while line := listener.next_line():
                now = time.monotonic() - begun
                if line.startswith("compiling "):
                    seconds["compiling_at"] = now
                elif match := COMPILED.match(line):
                    seconds |= {"compiled_at": now, "compile_seconds": float(match[1])}
                elif line.startswith(f"{RUN}: "):
                    return {**seconds, "first_line_at": now}
        finally:
            process.kill()
        process.wait()
        stderr.seek(0)
        raise RuntimeError(
            f"training ended (exit code {process.returncode}) before its first line:\n{stderr.read()}"
        )


def main() -> None:
    """Read the flags, measure, print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--preset", default="duel", help="what is trained (default %(default)s)")
    end_tidily()
    print(json.dumps(starts(parser.parse_args().preset), indent=2))


if __name__ == "__main__":
    main()
