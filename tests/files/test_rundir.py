"""The run directory: its name, who may write, and what happens when it goes away."""

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files.claim import claim_run, rescue_run, still_there
from dronecombat_jax.files.rundir import check_name, find_run, run_path

HOSTILE = [
    "",
    ".",
    "..",
    ".hidden",
    "a/b",
    "/abs",
    "../up",
    "a\nb",
    "a b",
    "é",
    "x" * 101,
    "a\x00b",
    "run\n",
]


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_are_refused(name: str):
    with pytest.raises(UserError) as caught:
        check_name(name)
    assert caught.value.exit_code == EXIT_CONFIG
    assert "\n" not in caught.value.message and len(caught.value.message) < 300


@pytest.mark.parametrize("name", ["ippo-paper", "A_1.b", "7", "x" * 100, "-x", "a.."])
def test_plain_names_pass(name: str):
    assert check_name(name) == name


def test_a_link_out_of_the_root_is_refused_but_the_root_may_be_a_link(tmp_path: Path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "runs").symlink_to(tmp_path / "disk")
    (tmp_path / "disk" / "out").symlink_to(tmp_path / "elsewhere")
    assert run_path(tmp_path / "runs", "fine").name == "fine"
    with pytest.raises(UserError, match="leads out of"):
        run_path(tmp_path / "runs", "out")


def test_claim_makes_the_folders_and_sweeps(tmp_path: Path):
    with claim_run(tmp_path / "a" / "runs", "one") as run:
        assert run.checkpoints.is_dir() and run.tensorboard.is_dir() and run.figures.is_dir()
        assert still_there(run)
        (run.checkpoints / ".tmp-3-1-aa").mkdir()
        (run.path / ".tmp-config.toml-1-aa").touch()
    with claim_run(tmp_path / "a" / "runs", "one") as run:
        assert list(run.checkpoints.iterdir()) == []
        assert sorted(path.name for path in run.path.iterdir()) == [
            ".lock",
            "checkpoints",
            "figures",
            "tensorboard",
        ]


def test_a_root_that_is_a_file(tmp_path: Path):
    (tmp_path / "runs").write_text("")
    with pytest.raises(UserError) as caught, claim_run(tmp_path / "runs", "one"):
        pass
    assert (
        caught.value.exit_code == EXIT_CANNOT_WRITE
        and str(tmp_path / "runs" / "one") in caught.value.message
    )


def test_a_read_only_file_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "one").mkdir()
    real = os.open

    def read_only(path: str, flags: int, *rest: int) -> int:
        if flags & os.O_CREAT:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return real(path, flags, *rest)

    monkeypatch.setattr(os, "open", read_only)
    with pytest.raises(UserError) as caught, claim_run(tmp_path, "one"):
        pass
    assert caught.value.exit_code == EXIT_CANNOT_WRITE
    assert str(tmp_path / "one") in caught.value.message and "Read-only" in caught.value.message


def test_an_unwritable_directory_is_refused_within_a_second(tmp_path: Path):
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    locked = tmp_path / "one"
    locked.mkdir(mode=0o555)
    start = time.monotonic()
    with pytest.raises(UserError) as caught, claim_run(tmp_path, "one"):
        pass
    assert caught.value.exit_code == EXIT_CANNOT_WRITE and time.monotonic() - start < 1.0


def test_claiming_and_asking_for_the_latest_need_no_jax(tmp_path: Path):
    script = (
        "import sys\n"
        "from dronecombat_jax.files.claim import claim_run\n"
        "from dronecombat_jax.files.checkpoint import latest\n"
        "with claim_run(sys.argv[1], 'one') as run: assert latest(run.checkpoints) is None\n"
        "assert not {'jax', 'orbax', 'mujoco', 'tensorboardX'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], check=True, timeout=30)


def test_find_run_by_name_and_path_and_what_it_suggests(tmp_path: Path):
    for name in ("ippo-paper", "ippo-smoke"):
        (tmp_path / name).mkdir()
    assert find_run("ippo-paper", tmp_path) == tmp_path / "ippo-paper"
    assert find_run(str(tmp_path / "ippo-smoke")) == tmp_path / "ippo-smoke"
    with pytest.raises(
        UserError, match=r"ipo-paper: no such run; did you mean ippo-paper\?"
    ) as caught:
        find_run("ipo-paper", tmp_path)
    assert caught.value.exit_code == EXIT_DATA
    with pytest.raises(UserError, match="no such run; runs there are: ippo-paper, ippo-smoke"):
        find_run("zzz", tmp_path)
    with pytest.raises(UserError, match="runs there are: none"):
        find_run("x" * 999, tmp_path / "absent")
    with pytest.raises(UserError, match="RUN is missing") as caught:
        find_run("")
    assert caught.value.exit_code == EXIT_CONFIG


@pytest.mark.parametrize("gone", ["renamed", "deleted", "replaced"])
def test_a_directory_that_went_away_is_noticed_and_rescued(tmp_path: Path, gone: str):
    with claim_run(tmp_path, "one") as run:
        run.path.rename(tmp_path / "other")
        if gone == "replaced":
            run.path.mkdir()
        assert not still_there(run)
        rescued = rescue_run(run)
        assert rescued.path == tmp_path / f"one.rescued-{os.getpid()}"
        assert still_there(rescued) and rescued.checkpoints.is_dir()
