"""Twenty `kill -9` at random moments of a real training, which then comes to the bits of one that
was left alone.
"""

import subprocess
import sys
from pathlib import Path

import pytest
from tiny import CHUNK, COMMAND, ENVIRONMENT, STEPS

from dronecombat_jax.cli import commands as cli
from dronecombat_jax.files import checkpoint, metrics

CHUNKS, KILLS = 90, 20
METHODS = {"ippo": (), "sippo": ("--selfplay.probability", "0.5", "--selfplay.roles", "both")}
# Forks children that have imported everything, so that a kill costs what the child did and not the
# imports. Kills come some records after a resume, which are up to three chunks; every fourth also
# before: while the child restores or compiles.
KILLER = """
import os, random, signal, sys, time
from pathlib import Path
from dronecombat_jax.machine import backend
from dronecombat_jax.config import settings
backend.prepare("cpu")
import orbax.checkpoint
from dronecombat_jax.combat import env, fingerprint
from dronecombat_jax.files import checkpoint
from dronecombat_jax.runs import training
from dronecombat_jax.selfplay import chunk
backend.import_mjx()

config = settings.load(Path(sys.argv[1]), {"run.name": sys.argv[2], "run.directory": sys.argv[3]})
run, kills, moments = Path(sys.argv[3], sys.argv[2]), int(sys.argv[4]), random.Random(5)

def begin():
    sys.stdout.flush()
    if child := os.fork():
        return child
    os._exit(training.train(config))

def size():
    log = run / "metrics.jsonl"
    return log.stat().st_size if log.exists() else 0

for kill in range(kills):
    kept = (checkpoint.steps(run / "checkpoints") or [-1])[-1]
    child = begin()
    deadline = time.monotonic() + (moments.uniform(0.0, 4.0) if kill % 4 == 3 else 300.0)
    low, wanted = size(), moments.randint(1, 12) * 1900  # bytes; a record has about 1900
    while size() - low < wanted and time.monotonic() < deadline:
        low = min(low, size())  # a resume cuts what lies past its checkpoint
        time.sleep(0.002)
    time.sleep(moments.uniform(0.0, 0.1))
    os.kill(child, signal.SIGKILL)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL, "ended before it was killed"
    good = checkpoint.latest(run / "checkpoints", set_aside=False)
    assert (good.step if good else -1) >= kept, "an acknowledged checkpoint is gone"
    print("killed after", checkpoint.steps(run / "checkpoints")[-1:], flush=True)
assert os.waitpid(begin(), 0)[1] == 0
"""


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_twenty_kills_at_random_moments_change_nothing(
    method: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    flags = [
        *COMMAND,
        *METHODS[method],
        "--steps",
        str(CHUNKS * CHUNK * STEPS),
        "--run.directory",
        str(tmp_path),
    ]
    assert cli.main(["train", *flags, "--print-config"]) == 0
    preset = tmp_path / "preset.toml"
    preset.write_text(capsys.readouterr().out)

    def train(name: str, kills: int) -> Path:
        command = [
            sys.executable,
            "-W",
            "ignore",
            "-c",
            KILLER,
            str(preset),
            name,
            str(tmp_path),
            str(kills),
        ]
        done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=500)
        assert done.returncode == 0 and done.stdout.count("killed after") == kills, (
            done.stdout + done.stderr
        )
        print(done.stdout)  # for whoever wants to know how far each one came: pytest -s
        return tmp_path / name

    alone, killed = train("alone", 0), train("killed", KILLS)
    digests = [
        checkpoint.verify(run / "checkpoints", CHUNKS * CHUNK).digest for run in (alone, killed)
    ]
    assert digests[0] == digests[1]
    assert (killed / "metrics.jsonl").read_bytes() == (alone / "metrics.jsonl").read_bytes()
    assert checkpoint.steps(killed / "checkpoints") == checkpoint.steps(alone / "checkpoints")
    chunks = [
        [row["outcome/reached"] for row in metrics.read(run / "chunks.jsonl")]
        for run in (alone, killed)
    ]
    assert chunks[0] == chunks[1] and len(chunks[0]) == 2 * CHUNKS
