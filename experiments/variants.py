"""A study: variants of the settings, some seeds each, one table.

    python experiments/variants.py experiments/studies/readings.toml [--lanes 2] [--only NAME ...]
    python experiments/variants.py experiments/studies/readings.toml --table

A study file names a `preset`, `steps`, `seeds` and its `[variants.NAME]`; a variant's keys are
`about`, its own `preset`, `steps` or `seeds`, and settings by dotted key in quotes; `on = "NAME"`
takes all but `about` from a variant above it, and changes that. Each variant and seed is one `dronecombat
train` on a core of its own, seeds first, so that every variant has one before any has two. Runs go
on where they stopped; what is whole is not trained again. Each run is measured when it is whole
(`experiments/measured.py`), and what it came to is kept beside the study file, as
studies/STUDY.jsonl (`kept`): commit that, and a study goes on on another machine. The table is
written to runs/STUDY/table.md.
"""

import argparse
import os
import queue
import subprocess
import sys
import threading
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parent))

import measured
from kept import Kept, settings_of

STOPPED = 75
OWN_KEYS = ("about", "preset", "steps", "seeds")


class Variant(NamedTuple):
    """One row of the table."""

    name: str
    about: str
    preset: str
    steps: int
    seeds: tuple[int, ...]
    settings: dict[str, Any]  # by dotted key

    def folder(self, root: Path, seed: int) -> Path:
        """Of the run of one seed."""
        return root / f"{self.name}-{seed}"

    @property
    def changed(self) -> dict[str, Any]:
        """Its settings that are not the package's defaults."""
        return settings_of(self.preset, self.settings, self.steps)


class Study(NamedTuple):
    """What a study file says."""

    name: str
    about: str
    variants: tuple[Variant, ...]


def read_study(path: Path) -> Study:
    """Read a study file. SystemExit, one line, for a file that cannot be read and for a key that is
    missing or unknown.
    """
    try:
        text = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SystemExit(f"{path}: {error}") from None
    if unknown := set(text) - {*OWN_KEYS, "variants"}:
        raise SystemExit(
            f"{path}: {min(unknown)}: no key of a study ({', '.join(OWN_KEYS)}, variants)"
        )
    variants = []
    above = {"": {key: text[key] for key in ("preset", "steps", "seeds") if key in text}}
    for name, own in text.get("variants", {}).items():
        base = str(own.get("on", ""))
        if base not in above:
            raise SystemExit(f"{path}: variants.{name}.on = {base!r}: no variant above it")
        keys = {**above[base], **{key: value for key, value in own.items() if key != "on"}}
        above[name] = {key: value for key, value in keys.items() if key != "about"}
        if lacking := {"preset", "steps", "seeds"} - set(keys):
            raise SystemExit(f"{path}: {min(lacking)} is missing, for variant {name}")
        settings = {key: value for key, value in keys.items() if key not in OWN_KEYS}
        about, seeds = keys.get("about", ""), tuple(keys["seeds"])
        variants.append(Variant(name, about, keys["preset"], keys["steps"], seeds, settings))
    return Study(path.stem, text.get("about", ""), tuple(variants))


def whole(study: Study, root: Path) -> dict[tuple[str, int], Path]:
    """The folders in `root` of the study's runs that are trained and measured, by variant and seed."""
    return {
        (variant.name, seed): folder
        for variant in study.variants
        for seed in variant.seeds
        if (folder := variant.folder(root, seed)).joinpath("measured.json").exists()
    }


def command(variant: Variant, seed: int, root: Path) -> list[str]:
    """The training of one seed, as a command."""
    words = [sys.executable, "-m", "dronecombat_jax", "train", "--preset", variant.preset]
    words += ["--seed", str(seed), "--steps", str(variant.steps)]
    words += ["--name", variant.folder(root, seed).name, "--run.directory", str(root)]
    words += ["--run.no-video", "--run.no-replay", "--run.no-figures"]
    for key, value in variant.settings.items():
        words += _spelled(key, value)
    return words


def _spelled(key: str, value: Any) -> list[str]:
    room, _, name = key.replace("_", "-").rpartition(".")
    if isinstance(value, bool):
        return [f"--{room}.{'' if value else 'no-'}{name}"]
    flag = f"--{room}.{name}"
    return [flag, *map(str, value)] if isinstance(value, list) else [f"{flag}={value}"]


def train_all(jobs: Sequence[tuple[Variant, int]], root: Path, lanes: int, kept: Kept) -> list[str]:
    """Train, measure and keep every job, `lanes` at a time, each on a core of its own; returns what
    failed.
    """
    waiting: queue.SimpleQueue[tuple[Variant, int]] = queue.SimpleQueue()
    for job in jobs:
        waiting.put(job)
    cores = sorted(os.sched_getaffinity(0))
    failed: list[str] = []
    writing = threading.Lock()

    def lane(core: int) -> None:
        while not waiting.empty():
            try:
                variant, seed = waiting.get_nowait()
            except queue.Empty:
                return
            if code := _train(variant, seed, root, core):
                failed.append(f"{variant.name}, seed {seed}: exit code {code}")
                if code == STOPPED:
                    return
                continue
            numbers = measured.of(variant.folder(root, seed), variant.steps)  # as was written
            with writing:
                if numbers is not None:
                    kept.keep(variant.name, seed, variant.changed, numbers)

    threads = [threading.Thread(target=lane, args=(cores[i % len(cores)],)) for i in range(lanes)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return failed


def _train(variant: Variant, seed: int, root: Path, core: int) -> int:
    log, run = root / f"{variant.name}-{seed}.log", variant.folder(root, seed)
    measure = [sys.executable, measured.__file__, str(run)]
    with log.open("a") as output:
        for words in (command(variant, seed, root), measure):
            code = subprocess.call(
                words,
                stdout=output,
                stderr=subprocess.STDOUT,
                preexec_fn=lambda: os.sched_setaffinity(0, {core}),
            )
            if code:
                break
    print(
        f"{variant.name}, seed {seed}: {'trained' if code == 0 else f'exit code {code}, see {log}'}",
        flush=True,
    )
    return code


def table(study: Study, kept: Kept) -> str:
    """The study's table, Markdown: a row for each variant with what its seeds have come to."""
    rows = []
    for variant in study.variants:
        runs = [kept.find(variant.name, seed, variant.changed) for seed in variant.seeds]
        rows.append((variant.name, variant.about, [run for run in runs if run is not None]))
    return measured.markdown(rows)


def read_flags() -> tuple[argparse.Namespace, Study]:
    """The command's flags, and the study that they name. SystemExit for a mistake."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", type=Path, help="a study file")
    parser.add_argument(
        "--lanes",
        type=int,
        default=len(os.sched_getaffinity(0)),
        help="trainings at a time (default: one a core)",
    )
    parser.add_argument(
        "--only", nargs="+", default=(), metavar="NAME", help="these variants alone"
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), help="folder that holds all studies"
    )
    parser.add_argument("--table", action="store_true", help="train nothing, print what there is")
    flags = parser.parse_args()
    if flags.lanes < 1:
        parser.error(f"--lanes {flags.lanes}: at least 1")
    study = read_study(flags.study)
    names = [variant.name for variant in study.variants]
    for name in flags.only:
        if name not in names:
            parser.error(f"--only {name}: no such variant in {flags.study} ({', '.join(names)})")
    return flags, study


def main() -> int:
    """Train what is missing, print the table; 1 where a training failed."""
    flags, study = read_flags()
    root = flags.runs / study.name
    root.mkdir(parents=True, exist_ok=True)
    kept = Kept(flags.study)
    chosen = [variant for variant in study.variants if not flags.only or variant.name in flags.only]
    most = max(len(variant.seeds) for variant in chosen)
    jobs = [
        (variant, variant.seeds[turn])
        for turn in range(most)
        for variant in chosen
        if turn < len(variant.seeds)
        and kept.find(variant.name, variant.seeds[turn], variant.changed) is None
    ]
    failed = [] if flags.table else train_all(jobs, root, flags.lanes, kept)
    text = table(study._replace(variants=tuple(chosen)), kept)
    if not flags.only:
        (root / "table.md").write_text(text + "\n")
    print(text)
    for line in failed:
        print(line, file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
